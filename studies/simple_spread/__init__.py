"""The learners beyond this project's own environment: MPE2's simple_spread, and public libraries.

Modules here that a public library's environment imports know nothing of ``orchid_uav``: ``task``,
``train``, ``fixed_batch``, and those named after the libraries.
"""
