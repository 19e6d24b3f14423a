"""Notes: one line for each kind, names in one line."""

from obscurance_addon.core.notes import Notes, named


def test_names_come_once_in_quotes_and_in_order():
    assert named(["B", "A", "B"]) == "'A', 'B'"


def test_names_that_a_line_has_no_room_for_are_counted():
    """A thousand names, and one very long one, take a line each; none is lost from the count."""
    names = [f"Object.{i:03}" for i in range(1000)]
    text = named(names)
    assert len(text) < 110
    assert text.count("'Object.") == 5
    assert text.endswith(" and 995 others")
    assert named(["x" * 500, "y"]) == f"'{'x' * 500}' and 1 other"


def test_names_cannot_break_the_line():
    """A line feed in a name is shown as one."""
    assert named(["new\nline"]) == "'new\\nline'"


def test_a_kind_is_one_line_however_often_it_is_said():
    """Equal words and cure: one line with all names; another cure: another line."""
    notes = Notes()
    assert not notes
    for name in ("B", "A", "B"):
        notes.add("left out", name, cure="repair them")
    notes.add("left out", "C")
    notes.add("nothing shines")
    assert notes.lines() == ["left out: 'A', 'B'; repair them", "left out: 'C'", "nothing shines"]
