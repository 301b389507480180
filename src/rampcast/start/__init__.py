"""The guided way in: what a stranger's table is, told by names, content and physics."""

from rampcast.start.asking import Answers, Question, StartError, answers_of
from rampcast.start.begin import Started, known_format, proposed, start

__all__ = ["Answers", "Question", "StartError", "Started", "answers_of", "known_format", "proposed", "start"]
