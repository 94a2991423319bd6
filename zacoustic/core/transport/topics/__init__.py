"""Samples that go once: best effort, alone or in dense blocks, and their deadlines."""
