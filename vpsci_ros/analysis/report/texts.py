"""What the report of a dataset says in whole sentences."""

READING = """<p>The unit of sampling is the clip for recorded near misses, whose interactions share cars and people, and
the episode for generated ones. Brackets are 95% percentile intervals of resampled units: they tell how much the numbers
depend on which clips or episodes were drawn, not how much on the training of the policies, and not how far these
recordings are from other places.</p>
<ul>
<li><b>Onset</b>: the first frame with CurvTTC of 5 s or less. <b>Conflict</b>: CurvTTC falls below 2 s.
<li><b>Yields</b>: slows down substantially and does not go first, by the rule of
<code>vpsci_ros.safety.who_yielded</code>; the paper's authors judged by eye. Near-miss tables begin a second before the
onset at most, so a recorded approach speed is sought no further back.
<li><b>D</b>: the greatest difference of two distribution functions (Kolmogorov and Smirnov). No p-value: recorded
interactions are not independent, and with this many generated ones any difference is significant. Compare D with that
between two halves of the recorded clips instead.
<li><b>Weighted to the same onsets</b>: generated encounters often begin later than recorded ones, and what begins at
2 s cannot be kept at 3 s. So the recorded ones are weighted until they begin as late, in classes of a second.
</ul>"""

TRAJECTORIES = """In the manner of the paper's Figure 7: vehicle blue, pedestrian red, the darker the faster, nearly
white is standing. Green: where they begin. Outlines: at the least CurvTTC."""

NEARNESS = """In the manner of Figure 8. Left of 0 a kernel density, right of it a histogram. Lines and numbers:
quartiles. Kept episodes only: a collision in the first 5 s ends its episode before it has the 100 frames that the
paper's third filter asks for."""

CONFLICTS = """In the manner of Figure 11: share of conflicts by the speeds at the onset. In the paper it grows with
both speeds. Grey: fewer than 10 interactions."""

YIELDING = """In the manner of Figures 9, 12 and 13, where only the pedestrian is shown: who yields by the distance at
the onset, and by the speeds and accelerations then. Grey: fewer than 10 interactions."""

ABSENT = """<ul>
<li>Errors (Table 9) are <code>vpsci evaluate</code>'s, on clips that the policies have not learned from; the course of
training (Figure 6) is in <code>learning.png</code> of the folder of stage 2.
<li>A Turing test (section 4.4) needs people who judge. None was made here, so nothing on this page says whether
people would take these episodes for real.
<li>Argoverse 2 and TGSIM (section 4.2) were not compared.
</ul>"""
