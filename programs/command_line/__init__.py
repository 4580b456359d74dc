"""Options, questions, sentences and output shared by several command lines."""
