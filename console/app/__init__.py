"""The console's screens. They know `console.frame.Frame` and a `FrameSource`, nothing of
devices or files."""
