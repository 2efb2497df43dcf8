"""The page about a drive.

``gather`` reads the bag once, in blocks; ``analysis`` computes; ``theory`` is the model beside it; ``findings`` puts
both into words, and ``page`` makes figures and HTML of it all.
"""
