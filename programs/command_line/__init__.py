"""Command lines: options, questions, sentences and output that several programs share."""
