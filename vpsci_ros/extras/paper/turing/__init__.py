"""The Turing test of section 4.4 as a kit: whether raters can distinguish recorded from generated interactions.

`clips` draws scenes and shows each three times: as recorded, as the policies go on from the same start, and as a
control does. `kit` writes the questionnaire, one HTML file that works without a network, and the key, which stays with
whoever asks; `answers` reads what the raters saved, `score` computes the statistics of section 4.4, `agreement` the
raters' agreement, and `result_page` writes Table 11 and Figure 10.
"""
