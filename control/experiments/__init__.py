"""What to measure next: design of experiments, by what each would read under each of the rivals.

`manoeuvres` are short runs of the machine at work, `bench_tests` what is tried in the yard;
both are an `Experiment`, and `experiment.chosen` picks those that tell rivals apart soonest.
`levels` are the settings that they go through.

Files:

- `bench_tests`: Cheap tests that a farm can make in its yard
- `experiment`: An experiment that a farm can make, and which of several tell rivals apart
- `levels`: The settings that experiments go through
- `manoeuvres`: Short runs that cost little, each as the log that it would leave of a given machine
"""
