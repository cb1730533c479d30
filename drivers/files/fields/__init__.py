"""Fields of other programs: outlines, obstacles, guidance lines, headland; in and out."""
