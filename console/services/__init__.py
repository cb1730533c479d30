"""What the pages have done with files and long work: the services of `console.app.services` on
real files."""
