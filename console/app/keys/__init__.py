"""The actions of each screen, a file a screen."""
