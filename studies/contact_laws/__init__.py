"""Contact laws compared with each other, and models of a joint with more and more detail."""
