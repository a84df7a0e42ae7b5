"""How words are written."""

from designer.base.words import capital


def test_names_at_the_beginning_of_a_sentence_stay_as_they_are() -> None:
    """A file or a camera is called as it is called."""
    sentences = ("left.mp4: 9 frames", "cam1 was turned", "run/left is cut off", "the focal length of cam1", "right.")
    assert [capital(one) for one in sentences] == [*sentences[:3], "The focal length of cam1", "Right."]
