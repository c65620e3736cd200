"""The ``orchid`` command: parsing, printing, exit codes."""
