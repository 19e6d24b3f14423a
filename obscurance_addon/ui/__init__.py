"""Operators and panels: gather input, call one function, report."""
