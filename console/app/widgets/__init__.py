"""What the screens are built of. Each shows one frozen view and is drawn again only when that
view changes."""
