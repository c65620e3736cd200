"""JSON documents as typed models: what is written is read back through the same class."""

from typing import Any, Self

from pydantic import BaseModel, ConfigDict, ValidationError

_LONGEST_VALUE = 80


class Document(BaseModel):
    """A JSON object whose keys are the fields of a subclass, in their order.

    Nothing is converted but whole numbers to floats: "1" is no number. Keys that a model does not
    know are kept and written again behind the others; keys that were never set are not written.
    """

    model_config = ConfigDict(strict=True, extra="allow")

    @classmethod
    def from_json(cls, document: Any) -> Self:
        """The model of a document that was read.

        Raises:
            ValueError: a key is missing or has another value than it may have, in one line.
        """
        try:
            return cls.model_validate(document)
        except ValidationError as error:
            raise ValueError(_first_complaint(error)) from None

    def to_json(self) -> dict[str, Any]:
        """The document as it is written."""
        return self.model_dump(by_alias=True, exclude_unset=True)


def rounded(value: Any, digits: int) -> Any:
    """A JSON document with its fractional numbers rounded to so many significant digits."""
    if isinstance(value, float):
        return float(f"{value:.{digits}g}")
    if isinstance(value, list):
        return [rounded(one, digits) for one in value]
    if isinstance(value, dict):
        return {key: rounded(one, digits) for key, one in value.items()}
    return value


def _first_complaint(error: ValidationError) -> str:
    first = error.errors(include_url=False)[0]
    key = ".".join(map(str, first["loc"]))
    if first["type"] == "missing":
        return f"it has no {key}"
    told = first["msg"].removeprefix("Value error, ")
    return f"{key} is {first['input']!r:.{_LONGEST_VALUE}}: {told}" if key else told
