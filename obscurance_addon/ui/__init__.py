"""Operators and panels: each gathers what the user set, calls one function, and reports.

In go what the user sets and presses. Out come calls of the packages of `blender`, and messages.
"""
