"""What to measure next: design of experiments, by what each would read under each of the rivals.

`manoeuvres` are short runs of the machine at work, `bench_tests` what is tried in the yard;
both are an `Experiment`, and `experiment.chosen` picks those that tell rivals apart soonest.
`levels` are the settings that they go through.
"""
