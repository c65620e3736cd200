"""Markup into which no text from outside can slip."""

from orchid_uav.experiments.markup import Markup, element, joined, table


class TestMarkup:
    def test_texts_and_attributes_are_escaped_and_markup_is_not(self):
        made = element("p", "a < b", element("b", "&"), title='"<', class_="x", data_k=1.5)
        assert made == '<p title="&quot;&lt;" class="x" data-k="1.5">a &lt; b<b>&amp;</b></p>'

    def test_attributes_without_a_value_are_left_out(self):
        assert element("meta", charset="utf-8", name=None) == '<meta charset="utf-8">'

    def test_joined_texts_are_escaped(self):
        assert joined(["<", Markup("<i>")], ", ") == "&lt;, <i>"

    def test_a_text_that_looks_like_a_cell_is_none(self):
        made = table("t", ["a", "b"], [["x", "<td>y"]])
        assert "<td>&lt;td&gt;y</td>" in made
