"""What the three papers print, and the same from this program's models; see `topdress
reproduce`."""
