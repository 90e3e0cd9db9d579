"""What the report of an exam says in whole sentences."""

OVERVIEW = """Above: full dots are the ADS, hollow ones the rule-based autopilot on the same episodes; bars are 95%
intervals. Below: the ADS."""

DIFFERENCES = """The ADS; pairs of episodes that begin alike. Bold where the interval leaves out 0. p: McNemar's exact
test; not corrected for the number of comparisons."""

RELIANCE = """First: share of the critical episodes without a contact, with the learned pedestrian. Second: the very
same episodes with the walker that does not react. Third: over all episodes, in percentage points."""

CONDUCT = """Refused: not finite, out of range, or for an earlier tick. Surplus: beyond the first one at a tick. At a
tick without a usable command the world's autopilot drives; such episodes count, and are marked in episodes.parquet
(unanswered), unless so many ticks were left to it (silent_ticks) that they are not the ADS's. Safe stops: in real time
only."""

WORST = "The worst of the ADS. Each is in runs/PEDESTRIAN/bag, for Foxglove or <code>vpsci bag plot</code>."

EPISODE = """Vehicle blue, pedestrian red, the darker the faster, nearly white is standing. Green: where they begin.
Outlines: at the least CurvTTC."""

READING = """<p>The unit of sampling is the episode: a spawn drawn by the seed in one of the scenarios, the same with
each pedestrian. Intervals are 95%: Wilson's for shares, Agresti and Min's for paired differences of shares, the
percentile bootstrap by episode (2,000 resamples) for all else. They tell how much the numbers depend on which episodes
were drawn, not how far this simulation is from a street.</p>
<p>Episodes are drawn so as to be critical: shares here are not rates in traffic. The pedestrians: the <b>learned</b>
one walks its route until CurvTTC falls below 5 s and then does what the policy does; the <b>walker</b> follows its
route whatever comes, and so walks into a vehicle that stands in its way; <b>constant velocity</b> keeps the velocity
with which it sets off; <b>social force</b> is repelled by the vehicle; <b>recorded people</b> do what they did in front
of another car. The learned pedestrian is no person: its model card (vpsci_ros/models) says how far it is from one.</p>
"""
