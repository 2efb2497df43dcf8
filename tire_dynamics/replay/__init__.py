"""Messages in, messages out: the pipeline that live node and replay share, its parameters, and bags through it."""
