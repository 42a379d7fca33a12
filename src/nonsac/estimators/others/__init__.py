"""Other people's estimators as cores, by name: a file for each library, which is imported only if it is asked for."""
