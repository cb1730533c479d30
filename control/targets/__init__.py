"""Which target holds where: profiles along the track, and the queue of rate changes that looks
ahead."""
