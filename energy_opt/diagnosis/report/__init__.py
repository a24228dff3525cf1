"""The diagnosis in words, tables and pictures."""
