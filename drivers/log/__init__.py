"""No drives: joints of an arm that is known from logs alone."""
