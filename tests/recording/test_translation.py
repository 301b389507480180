import polars as pl

from rampcast.recording.translation import as_words, translated


def words(*texts):
    return pl.Series("word", texts, dtype=pl.Categorical())


def test_each_word_becomes_what_it_stands_for_and_all_others_null():
    found = translated(
        words("b", None, "a", "other", "b"), words("a", "b", "never"), pl.Series([1, 2, 3], dtype=pl.Int16)
    )
    assert found.to_list() == [2, None, 1, None, 2]
    assert found.dtype == pl.Int16
    assert found.name == "word"


def test_where_no_word_is_known_all_are_null():
    assert translated(words("a", None), words(), pl.Series([], dtype=pl.String)).to_list() == [None, None]


def test_numbers_become_words_and_null_stays_null():
    found = as_words(pl.Series("lane", [3, None, -1, 3], dtype=pl.Int16))
    assert found.cast(pl.String).to_list() == ["3", None, "-1", "3"]
    assert as_words(pl.Series([None, None], dtype=pl.Int16)).to_list() == [None, None]
