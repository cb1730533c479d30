"""What is written for people to read: diagnosis summaries and reports, job reports, pictures."""
