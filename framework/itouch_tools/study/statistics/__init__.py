"""Statistics of psychophysical studies: functions of plain tables, independent of scenes and devices."""

from itouch_tools.study.statistics.confusion import (
    Choice,
    Information,
    choice_model,
    confusion_matrix,
    information_transfer,
    kappa,
    proportion_correct,
)
from itouch_tools.study.statistics.detection import (
    correct_of_alternatives,
    correct_of_oddity,
    criterion_of_rates,
    d_prime_of_alternatives,
    d_prime_of_oddity,
    d_prime_of_rates,
    log_linear,
)
from itouch_tools.study.statistics.proportions import (
    Equivalence,
    Outcome,
    binomial_tail,
    clustered_tost,
    cochran_q,
    holm,
    mcnemar,
    tost,
    wilson,
)
from itouch_tools.study.statistics.psychometric import (
    Psychometric,
    beta_binomial_log_pmf,
    fit_psychometric,
    profile_interval,
)
from itouch_tools.study.statistics.regression import Term, logistic_gee
from itouch_tools.study.statistics.resampling import participant_interval, share_interval

__all__ = [
    "Choice",
    "Equivalence",
    "Information",
    "Outcome",
    "Psychometric",
    "Term",
    "beta_binomial_log_pmf",
    "binomial_tail",
    "choice_model",
    "clustered_tost",
    "cochran_q",
    "confusion_matrix",
    "correct_of_alternatives",
    "correct_of_oddity",
    "criterion_of_rates",
    "d_prime_of_alternatives",
    "d_prime_of_oddity",
    "d_prime_of_rates",
    "fit_psychometric",
    "holm",
    "information_transfer",
    "kappa",
    "log_linear",
    "logistic_gee",
    "mcnemar",
    "participant_interval",
    "profile_interval",
    "proportion_correct",
    "share_interval",
    "tost",
    "wilson",
]
