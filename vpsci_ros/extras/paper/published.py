"""Values published in the paper: Tables 3, 9 and 11, and two of section 4; the others are in `data.published`."""

from typing import NamedTuple


class PublishedSample(NamedTuple):
    """A row of the paper's Table 3: rewards and critic loss of stage 1."""

    vehicle_reward: float
    pedestrian_reward: float
    critic_loss: float


TABLE_3 = {  # interactions -> row
    50: PublishedSample(-6.83, -7.21, 0.4812),
    100: PublishedSample(-5.47, -6.03, 0.3654),
    150: PublishedSample(-4.12, -4.89, 0.2431),
    200: PublishedSample(-2.14, -3.67, 0.1124),
    250: PublishedSample(-2.09, -3.61, 0.1098),
    336: PublishedSample(-1.94, -3.52, 0.1073),
}


class PublishedModel(NamedTuple):
    """A row of the paper's Table 9: the model's name in the paper, and its errors [m] on the paper's data."""

    name: str
    ade: float
    fde: float


TABLE_9 = {  # names of vpsci_ros.policy.models, "_refined" for hybrid learning -> row, of the models in the package
    "ma_sst_ddpg_refined": PublishedModel("Refined MA-SST-DDPG", 0.072, 0.142),
    "ma_transformer_ddpg_refined": PublishedModel("Refined MA-Transformer-DDPG", 0.094, 0.194),
    "ma_ddpg_refined": PublishedModel("Refined MA-DDPG", 0.157, 0.305),
    "ma_sst_ddpg": PublishedModel("MA-SST-DDPG", 0.078, 0.156),
    "ma_transformer_ddpg": PublishedModel("MA-Transformer-DDPG", 0.098, 0.196),
    "ma_ddpg": PublishedModel("MA-DDPG", 0.164, 0.328),
    "transformer_ddpg_refined": PublishedModel("Refined Transformer-DDPG", 0.257, 0.505),
    "ddpg_refined": PublishedModel("Refined DDPG", 0.623, 1.273),
    "transformer_ddpg": PublishedModel("Transformer-DDPG", 0.271, 0.542),
    "ddpg": PublishedModel("DDPG", 0.679, 1.357),
    "transformer_refined": PublishedModel("Refined Transformer", 1.203, 2.205),
    "lstm_refined": PublishedModel("Refined LSTM", 1.771, 2.551),
    "feedforward_refined": PublishedModel("Refined NN", 2.586, 3.989),
    "transformer": PublishedModel("Transformer", 1.199, 2.398),
    "lstm": PublishedModel("LSTM", 1.783, 2.566),
    "feedforward": PublishedModel("NN", 2.677, 3.955),
}


class PublishedPair(NamedTuple):
    """A row of the paper's Table 11: the comparison of the realism scores of two sources."""

    t: float
    p: str
    d: float
    low: float
    high: float
    tost: str
    conclusion: str


TABLE_11 = {  # pairs of `turing.clips.SOURCES` -> row
    ("rule_based", "generated"): PublishedPair(-13.50, "<0.001", -1.33, -1.85, -1.38, "1", "different"),
    ("rule_based", "recorded"): PublishedPair(-13.62, "<0.001", -1.35, -1.86, -1.39, "1", "different"),
    ("generated", "recorded"): PublishedPair(-0.09, "0.92", -0.009, -0.22, 0.20, "<0.001", "equivalent"),
}
ICC_2K = (0.763, 0.590, 0.830)  # ICC(2,k) with its interval, 44 raters
KS, WASSERSTEIN = 0.0149, 0.0150  # between the least CurvTTC [s] of the published and of the real near misses
CRITICAL_SHARES = {"argoverse2": 0.2518, "tgsim": 0.5577}  # of interactions with CurvTTC below 5 s, section 4.2
