"""Words that many rows share: what each stands for is looked up once, and not in every row."""

import numpy as np
import polars as pl


def translated(words: pl.Series, old: pl.Series, new: pl.Series) -> pl.Series:
    """Returns the new value of each word; null where a word is not among the old ones.

    Args:
        words: categories.
        old: categories, each once, none null.
        new: what they stand for.
    """
    codes, places = words.to_physical(), old.to_physical()
    highest = max(int(one.drop_nulls().to_numpy().max(initial=0)) for one in (codes, places))
    index = np.full(highest + 1, len(new))
    index[places.to_numpy()] = np.arange(len(new))
    return new.extend_constant(None, 1).gather(pl.Series(index)).gather(codes).alias(words.name)


def as_words(numbers: pl.Series) -> pl.Series:
    """Returns whole numbers of a small range, as those of lanes, as words; null where there is none."""
    known = numbers.drop_nulls().to_numpy()
    if not len(known):
        return numbers.cast(pl.String).cast(pl.Categorical())
    low, high = int(known.min()), int(known.max())
    names = pl.Series([str(number) for number in range(low, high + 1)], dtype=pl.Categorical())
    return names.gather(numbers - low).alias(numbers.name)
