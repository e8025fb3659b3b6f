"""Advice that a message gives twice, such as the remedy of an error and that of its cause."""


def repetitions(text: str, length: int = 8) -> list[str]:
    """The runs of `length` words that occur more than once in a text."""
    words = text.split()
    runs = [" ".join(words[k : k + length]) for k in range(len(words) - length + 1)]
    return sorted({run for run in runs if runs.count(run) > 1})
