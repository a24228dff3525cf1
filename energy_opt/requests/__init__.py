"""Requests: one dataclass for each verb. The command line, Python and JSON documents are derived from it."""
