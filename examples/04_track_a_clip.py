"""Track an object from Python: python 04_track_a_clip.py [SOURCE [FRAMES [FOLDER]]]

SOURCE is a video file, camera:N or, by default, scene:twin. Of a file, say where the object is in ``box`` below.
Writes the track as CSV, the frames with contours as MP4, and the last frame as a figure.
"""

import sys
from itertools import islice
from pathlib import Path

from pfviz import make_filter
from pfviz.figures import plot_frame, render
from pfviz.vision import (
    Restarting,
    VideoWriter,
    draw_track,
    learn_tracker,
    open_source,
    suggested_box,
    track,
    write_csv,
)

words = sys.argv[1:] + ["scene:twin", "60", "."][len(sys.argv) - 1 :]
source_name, count, folder = words[0], int(words[1]), Path(words[2])

with open_source(source_name) as source:
    box = suggested_box(source, 0)  # or (x, y, width, height) in pixels
    if box is None:
        sys.exit(f"{source_name} does not say where the object is: set box to (x, y, width, height)")
    model = learn_tracker(source.read(0), box, frame_rate=source.frame_rate)
    filter_ = Restarting(make_filter("rb-ss-hs-sir", 400))  # looks for the object again when it is lost
    tracked = list(islice(track(source, model, filter_, seed=0), count))
    with VideoWriter(folder / "track.mp4", source.size, source.frame_rate) as video:
        for item in tracked:
            video.write(draw_track(item.image, model, item.record, item.estimate))
    with open(folder / "track.csv", "w", newline="") as table:
        rows = write_csv(table, tracked)

last = tracked[-1]
figure = plot_frame(last.image, model, last.record, last.estimate, title=f"frame {last.frame}")
(folder / "last-frame.png").write_bytes(render(figure))
print(f"{rows} frames; at the end x = {last.estimate.x:.1f}, y = {last.estimate.y:.1f}, ESS", end=" ")
print(f"{last.record.effective_sample_size:.0f} of {len(last.record.posterior)}")
