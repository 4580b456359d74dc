"""Motors with their controllers in one, of any make, that let go when nothing is sent to them."""
