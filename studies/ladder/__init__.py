"""One joint by models of more and more detail."""
