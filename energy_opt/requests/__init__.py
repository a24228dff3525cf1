"""What each verb can be asked: one dataclass a verb, from which command line, Python and JSON documents are derived."""
