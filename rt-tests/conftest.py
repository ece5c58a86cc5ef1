"""Lets the tests below import `processes`: pytest puts this folder on the path."""
