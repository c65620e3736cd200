"""The figures of a reproduction, after the paper's."""
