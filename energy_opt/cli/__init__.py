"""The command line: options from requests, messages and progress, streams, faults and example files."""
