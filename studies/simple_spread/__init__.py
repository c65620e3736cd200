"""The learners compared with public libraries, on MPE2's simple_spread.

Some modules here run in the Python environment of a public library and do not import
``orchid_uav``: ``task``, ``train``, ``fixed_batch``, and those named after the libraries.
"""
