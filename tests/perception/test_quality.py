"""Qualities are messages to a person."""

from perception.quality import Quality


def test_every_quality_is_a_sentence_of_its_own():
    sentences = [quality.value for quality in Quality]
    assert len(set(sentences)) == len(sentences)
    assert all(text[0].isupper() and text.endswith(".") and " " in text for text in sentences)
