"""Motors with integrated controllers, of any make, that go limp without frames."""
