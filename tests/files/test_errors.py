"""What messages quote of a file is written by others."""

import pickle

import pytest

from nonsac.files.errors import InputError, input_error
from nonsac.values.numeric import printable


@pytest.mark.parametrize(
    "word", ["\x1b[2J", "\x00", "\x7f", "\x9b31m", "\u2028", "\u202e", "\u2066", "\x85", "\r\n", "\x08"]
)
def test_no_control_characters(word):
    message = str(input_error("a.csv", f"names the column x{word}y", "rename it"))
    assert message.isprintable()
    assert message.startswith("a.csv: names the column x")
    assert message.endswith("y; rename it")


def test_letters_of_all_languages_stay():
    message = "点云/été.ply: naïve ß 数; do ½"
    assert printable(message) == message
    assert printable("\udce9.ply") == "\udce9.ply"  # a name that is no UTF-8


def test_long_words_are_cut_and_the_fix_stays():
    message = str(input_error("a.csv", f"names {'x' * 10**6}", "rename it"))
    assert len(message) < 2100
    assert message.startswith("a.csv: names xxx")
    assert message.endswith("xxx; rename it")


def test_errors_travel():
    error = pickle.loads(pickle.dumps(InputError("a.csv: \x1b; fix it")))
    assert type(error) is InputError
    assert str(error) == "a.csv: \\x1b; fix it"
