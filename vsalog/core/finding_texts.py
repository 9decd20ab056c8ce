"""The catalogue of findings: the text of each code, and what to do about it. docs/reference/findings is made of it.

Texts of codes that only one check gives are in its file.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from shlex import quote
from string import Formatter
from typing import Any

from vsalog.core.finding import Finding, Severity, Text
from vsalog.core.finding_texts_log import LOG_TEXTS
from vsalog.core.printable import plural
from vsalog.core.significance import FALSE_ALARM

# Texts name what an error depends on; which parameter of the rig causes it, a simulation of the rig shows.
DIAGNOSE = "'vsalog diagnose LOG' searches for the cause and extends the rig by it."

TEXTS: dict[str, Text] = {
    **LOG_TEXTS,
    "encoder.other_turn": Text("{part} was on another turn than link_position.", "Whole turns are added to it."),
    "torque.drive_model": Text(
        "{part} is the recorded torque as the drive model of the rig's motor changes it: {made}.",
        "Correct the drive model in the rig if the recorded torque is the motor's own.",
    ),
    "torque.computed": Text(
        "{part} is exactly {factor:.6g} times {source}: it was computed from it, not measured.",
        "The stiffness is then a constant of that computation, and the torque cannot validate a model.",
    ),
    "torque.offset_as_ramp": Text(
        "transmission {part}: the motor's torque seems to be off by {value:+.3g} N·m all along, which an integrated"
        " equation takes for the spring's: nothing counts as excited.",
        "Set torque_offset of the motor in the rig, or offset of its signal, or use --estimator residual-rls.",
    ),
    "sensor.stuck": Text(
        "{part} was stuck at {value:.0f} of {samples} samples (first at {first:.6g} s): it stood still amid a motion and then"
        " jumped to catch up.",
        "They are left out.",
    ),
    "sensor.constant": Text("{part} never changes.", "Check the channel in the rig if it should."),
    "deflection.too_small": Text(
        "transmission {part}: the deflection spans {value:.1f} steps of its encoders, too few for a stiffness.",
        "Move the joint more.",
    ),
    "deflection.below_noise": Text(
        "the motor's encoder leaves a noise of {value:.2g} rad in the deflection, which the motor's torque never makes"
        " larger than {limit:.2g} rad.",
        "The estimated torque is noise.",
    ),
    "estimate.torn": Text(
        "transmission {part}: samples are missing so often that the filters' windows are whole for {value:.0%} of the time"
        " only.",
        "Shorten the windows (--tune window=SECONDS), or repair the log.",
    ),
    "estimate.too_short": Text(
        "transmission {part}: the log ends after {value:.3g} s, before the uncertainty of a stiffness, or the range of its"
        " deflections, is known: nothing counts as excited.",
        "Use more of the log (--start, --end), or record longer.",
    ),
    "estimate.never_excited": Text(
        "transmission {part} is excited nowhere (the standard deviation is above a fifth of the stiffness everywhere).",
        "Move the joint more.",
    ),
    "estimate.fit_never_excited": Text(
        "transmission {part} is excited nowhere (the standard deviation is above a fifth of the stiffness everywhere).",
        "Move the joint more, or fit fewer terms (order under [joint.{joint}.basis] in the rig).",
    ),
    "estimate.partly_excited": Text(
        "transmission {part}: the estimate is excited for {value:.0%} of the time only.",
        "Column excited shows when.",
    ),
    "fit.offset": Text(
        "transmission {part}: the torque differs by {value:+.3g} N·m from the fit on average, an offset that odd powers of the"
        " deflection cannot follow.",
        "Set odd = false under [joint.{joint}.basis], or the offset of the torque's signal.",
    ),
    "stiffness.negative": Text(
        "transmission {part}: a negative stiffness was estimated for {value:.0%} of the time.",
        "Check the signs of the torque and of the positions in the rig (sign = -1), and whether motor and link are swapped.",
    ),
    "residual.follows_motion": Text(
        "transmission {part}: the residual follows the motor's {signal}, as it does where a sensor is late or wrong, or the rig"
        " is, and the stiffness is {value:.0%} off by that. What would explain it: {explained_by}.",
        "'vsalog diagnose' finds which it is.",
    ),
    "residual.not_noise": Text(
        "transmission {part}: the residual is {value:.0%} of the torque and no noise, for it does not average out: a sensor"
        " is stuck, clipped or wrong for a while, the spring changes, or the basis cannot follow it ([joint.{joint}.basis]"
        " order).",
        "The stiffness may be further off than its standard deviation.",
    ),
    "prior.holds_back": Text(
        "transmission {part}: in {value:.0%} of the excited samples the prior biases a stiffness that the log alone would"
        " determine: with a weaker prior it differs by {stiffness_change:.0%} (rms), which its standard deviation includes.",
        "Few springs are far from the prior: check that the signs, units and zeros of the positions, and of the set-point"
        " where there is"
        " one, agree with the rig; if they do, --tune p0={p0:.2g} lets the log decide.",
    ),
    "stiffness.drifts": Text(
        "transmission {part}: the stiffness changes by {value:.1%} over the log, more than {limit:.1%}, the noise floor; the"
        " estimate lags behind, which its standard deviation includes.",
        "Springs and drives that warm up do that, and torque sensors that drift: record after warming up, or estimate parts"
        " of the log.",
    ),
    "spring.loop": Text(
        "transmission {part}: its torque has a loop of ±{value:.3g} N·m: loading and unloading differ. The stiffness is that of"
        " the middle of the loop.",
        "Set slip elements of the transmission in the rig, or branches = true under [joint.{joint}.basis] for a stiffness of"
        " each"
        " branch; 'vsalog diagnose' separates hysteresis from friction.",
        false_alarm=FALSE_ALARM,
    ),
    "spring.bouc_wen": Text(
        "transmission {part}: the loop, or a part of it, is that of Bouc and Wen with ±{value:.3g} N·m, a width of {width:.3g}"
        " rad (± {width_std:.1g} rad, 1 std), an exponent of {exponent:.3g} ({least:.3g} to {most:.3g}) and a shape of"
        " {shape:.2g} (± {shape_std:.1g}, 1 std).",
        "For other estimators and for simulations give the transmission this bouc_wen in the rig: torque = {value:.4g},"
        " width = {width:.4g}, exponent = {exponent:.3g}, shape = {shape:.3g}.",
        false_alarm=FALSE_ALARM,
    ),
    "spring.slip": Text(
        "transmission {part}: the loop, or a part of it, is that of a spring of {stiffness:.4g} N·m/rad (± {stiffness_std:.1g}, 1"
        " std) in series with dry friction that slips at {value:.3g} N·m.",
        "For other estimators and for simulations add this element to slip of the transmission in the rig: stiffness ="
        " {stiffness:.4g}, limit = {value:.4g}.",
        false_alarm=FALSE_ALARM,
    ),
    "spring.not_polynomial": Text(
        "the spring is no polynomial of the rig's order, as with a corner or a knee: the estimate follows it by a spline.",
        "Set knots = {knots} under [joint.{joint}.basis] for other estimators.",
        false_alarm=FALSE_ALARM,
    ),
    "spring.corner": Text(
        "transmission {part}: the stiffness jumps by {value:+.3g} N·m/rad at a deflection of {deflection:.4g} rad"
        " (± {deflection_std:.1g} rad, 1 std), as at a stop, at the end of a backlash or where a second spring begins to act.",
        "Set corners = [{corners}] under [joint.{joint}.basis] for other estimators.",
        false_alarm=FALSE_ALARM,
    ),
    "spring.setpoint_not_polynomial": Text(
        "the torque is no polynomial of the set-point of the rig's order: the estimate follows the set-point by a spline.",
        "Set setpoint_knots = {pieces} under [joint.{joint}.basis] for other estimators.",
        false_alarm=FALSE_ALARM,
    ),
    "stiffness.changed": Text(
        "transmission {part}: the stiffness changes by {value:+.1%} from the log's beginning to its end, between {least:+.1%} and"
        " {most:+.1%} of what it is at the beginning, with {jumps:n sudden change}; the estimate follows it.",
        "A change larger or more frequent than a spring's has another cause, which 'vsalog diagnose' searches for.",
        false_alarm=FALSE_ALARM,
    ),
    "filter.smooths_motion": Text(
        "transmission {part}: a window of {window:g} s smooths the motion away: {value:.0%} of the deflection's rate is"
        " left, and the stiffness is that of the smoothed motion.",
        "Shorten the window, or leave it out to have it chosen by the log.",
    ),
    "filter.noisy_rate": Text(
        "transmission {part}: {value:.0%} of the deflection's rate is the encoders' noise, which biases the stiffness by"
        " more than its standard deviation (errors-in-variables bias).",
        "Move the joint faster, or filter longer (--tune window=SECONDS).",
    ),
    "filter.window_too_long": Text(
        "the filter's window of {value:.2g} s is longer than the deflection takes from one end to the other ({limit:.2g}"
        " s): it smooths away what the stiffness changes by on the way, and the standard deviation does not know by how"
        " much.",
        "Record at a higher rate, or move more slowly.",
    ),
    "sampling.too_slow": Text(
        "transmission {part}: from every second sample only, the stiffness differs by up to {stiffness_change:.0%}, which"
        " its standard deviation includes: the samples are too few for so fast a motion, or for a spring that changes so"
        " suddenly.",
        "Record at a higher rate, or move more smoothly.",
    ),
    "sampling.too_slow_for_total": Text(
        "from every second sample only, the stiffness of the whole joint differs by up to {stiffness_change:.0%}, which its"
        " standard deviation includes: the samples are too few for so fast a motion, or for a spring that changes so"
        " suddenly.",
        "Record at a higher rate, or move more smoothly.",
    ),
    "sampling.untried": Text(
        "half of the samples are too few for this estimator, so nothing shows whether all of them are enough for the"
        " motion; the stiffness may be off by more than its standard deviation.",
        "Record at a higher rate, or longer.",
    ),
    "setpoint.constant": Text(
        "the set-point never changes in this log.",
        "If it changed on the machine, this may explain the other findings.",
    ),
    "friction.unknown_direction": Text(
        "transmission {part}: for {value:.0%} of the time the torque of friction or hysteresis that the rig has is not"
        " known, because the motor is at rest or slower than its encoder resolves, or the deflection has not yet moved"
        " through its loop.",
        "The fit does not use these samples.",
    ),
    "transmission.effects_left_in": Text(
        "transmission {part}: {estimator} does not compensate the damping and the hysteresis of the rig.",
        "They bias the stiffness.",
    ),
    "motor.inertia_differs": Text(
        "transmission {part}: the motor's inertia is estimated as {inertia:.3g} kg·m², {ratio:.3g} times the rig's {rig:.3g}.",
        "A torque's scale or unit, the angles' unit, a nonlinear encoder or a gear ratio would explain it, and the stiffness"
        " would be as far off; or the rig has another motor's inertia.",
    ),
    "sensor.dead": Text(
        "{part} is {value:.6g} {unit} from beginning to end, like the output of a sensor that is off or not connected; the"
        " joint was estimated without it.",
        "Put the right channel into the rig ('vsalog inspect' shows the values of each), or leave the role out.",
    ),
    "torque.gain_differs": Text(
        "transmission {part}: the gain of {signal} is {value:.3g} times the one that the joint's other equations give; the"
        " estimate is corrected by that.",
        "Two torques disagree, and only a motor's inertia in the rig tells which is wrong: without it the torque sensor's is"
        " taken to be right. Calibrate both, and set the wrong one's gain in the rig. Damping or friction that the rig lacks may"
        " have the same effect.",
        explains=("cross_check.torque_scale",),
    ),
    "link.inertia_not_estimated": Text(
        "there is no link_position, so the link's inertia and damping are not estimated.",
        "Name its channel under [joint.{joint}.signals] in the rig to have them.",
    ),
    "link.estimate_biased": Text(
        "noise or steps of the sensors, or samples that are too few for the motion, bias the link's {part} by more than"
        " {limit:.0%}, which is left out.",
        "Move the link harder, or record faster.",
    ),
    "link.other_torque": Text(
        "the link moves as if dry friction of {friction:.2g} N·m and a constant torque of {torque:.2g} N·m acted on it too,"
        " which neither the rig nor the torque sensor shows; with these its inertia would change by"
        " {inertia_change:.0%}, its damping by {damping_change:.0%}.",
        "So much is added to their standard deviations, and what changes by a fifth is left out.",
    ),
    "link.not_explained": Text(
        "the link does not move as an inertia and a damping under the measured torque would: innovations are {value:.2g}"
        " times as large as noise explains.",
        "Weight, friction or a push may be missing in the rig, encoder and torque sensor may disagree in sign, or samples"
        " may be too few for the motion; inertia and damping are left out where that is so.",
    ),
    "link.filter_restarted": Text(
        "the link does not move as an inertia and a damping under the measured torque would: the filter began again"
        " {value:.0f} times, because inertia and damping had become negative.",
        "Weight, friction or a push may be missing in the rig, encoder and torque sensor may disagree in sign, or samples"
        " may be too few for the motion; inertia and damping are left out where that is so.",
    ),
    "link.guess_matters": Text(
        "stiffness and link did not settle: from an initial guess of {guess:.3g} kg·m² the inertia came to {inertia:.3g},"
        " from {factor:g} times that to {other_inertia:.3g} kg·m². Stiffness, inertia and damping depend on the guess"
        " (Serio 2011 §III-A).",
        "Push the link harder and at more frequencies, or measure the joint's torque (--estimator impedance).",
    ),
    "link.friction_left_in": Text(
        "the link's dry friction is not compensated.",
        "It biases the stiffness.",
    ),
    "external_torque.missing": Text(
        "there is no external_torque, so the transmission alone is assumed to drive the link.",
        "Any external push biases the stiffness.",
    ),
    "accelerometer.off": Text(
        "{part} is {value:.3g} {unit} (rms) away from the acceleration that the motors' motion and gravity give it, where the"
        " link has"
        " {expected:.3g} {unit}.",
        "The sensor may be upside down, turned, in another unit (g instead of m/s²), or mounted elsewhere than in the"
        " rig; the estimate has an error of that size.",
    ),
    "accelerometer.scale": Text(
        "{part} is {value:.3g} {unit} (rms) away from the acceleration that the motors' motion and gravity give it, where the"
        " link has"
        " {expected:.3g} {unit}: it is {factor:.3g} times what it should be.",
        "The sensor may be upside down, turned, in another unit (g instead of m/s²), or mounted elsewhere than in the"
        " rig; the estimate has an error of that size.",
    ),
    "acceleration.masked": Text(
        "for {value:.1%} of the time nothing is estimated: samples are missing, or the accelerometers lie within {reach:g}"
        " m of the joint's axis, or in line with those of others, and measure almost none of its acceleration.",
        "Set that distance with --tune reach=METRES.",
    ),
    "observer.diverged": Text(
        "the observers diverged {value:.0f} times, to deflections that no motor torque explains, and restarted:"
        " positions that the accelerometers do not determine for long make all accelerations wrong.",
        "Mount an accelerometer on every link.",
    ),
    "pressure.below_outside": Text(
        "{part} falls to {value:.4g} kPa, below the {outside:.4g} kPa outside, which no valve can cause.",
        "Check that it is absolute, and that the rig's outside_pressure is that of the day.",
    ),
    "pressure.angle_unknown": Text(
        "for {value:.1%} of the time the pressures do not determine the angle, not even to a quarter turn, and nothing is"
        " estimated there: muscles that are nearly vented hardly hold the joint, and their pressures do not change with it.",
        "Fill both.",
    ),
    "pressure.not_explained": Text(
        "for {value:.1%} of the time the pressures are not those that the rig's valves and muscles would produce, and nothing"
        " is estimated there.",
        "The valves may be swapped, a pressure may not be absolute, or the rig is another machine's.",
    ),
    "validation.error": Text(
        "judged by the {reference}, the flexibility torque of transmission {part} is off by {value:.3g} % of the torque's span"
        " (95 %: {low:.3g} to {high:.3g} %).",
        "Up to {limit:g} % the model holds.",
    ),
    "validation.gain_off": Text(
        "the torque of transmission {part} is measured {value:.4g} times as large as predicted.",
        "Even if that is small relative to the torque's span, the spring or the sensor's gain has changed.",
    ),
    "validation.stiffness_by_truth": Text(
        "the stiffness of transmission {part} is {value:.3g} % (rms, 95 %: {low:.3g} to {high:.3g} %) off the log's true one.",
        "Up to {limit:g} % it holds.",
    ),
    "validation.stiffness_by_nominal": Text(
        "the stiffness of transmission {part} is {value:.3g} % (rms, 95 %: {low:.3g} to {high:.3g} %) off the rig's nominal"
        " one.",
        "Up to {limit:g} % they agree; beyond that the spring or the rig is wrong, and this test cannot separate the two.",
    ),
    "validation.inside_region": Text(
        "{value:.2%} of the log lies in the region that the model was fitted in, and no sample that can be judged lies outside."
    ),
    "validation.outside_region": Text(
        "{value:.2%} of the log lies outside the region that the model was fitted in.",
        "It is extrapolation there and judged separately: the table of samples outside shows its error.",
    ),
    "validation.own_log": Text(
        "the model was fitted to this log, so it is no second experiment: judged by the {reference}, the model fits it"
        " with an error of {value:.3g} % of the torque's span.",
        "Only another experiment shows how well it predicts.",
    ),
    "validation.same_log": Text("{log} is the same log as {same_as}, given before."),
    "validation.compared_only": Text(
        "against the {reference}, the flexibility torque of transmission {part} is off by {value:.3g} % of the torque's span,"
        " which is for comparison only.",
        "Record a torque sensor to judge the model by.",
    ),
    "validation.part_unjudged": Text(
        "of transmission {part} no sample lies in the region that the model was fitted in, or too little was measured.",
        "Fit the model on an experiment that covers these deflections and set-points.",
    ),
    "validation.reference_constant": Text(
        "the {reference} of transmission {part} never changes, so an error has no span to be compared with: the sensor may be"
        " stuck or unplugged.",
        "Check whether the rig names the right channel.",
    ),
    "validation.too_few_samples": Text(
        "{value:.0f} samples or fewer of transmission {part} can be judged and lie in the region that the model was fitted in;"
        " an error's size needs {limit:.0f}, 8 windows of the filter.",
        "Record longer, or fit the model on an experiment that covers these deflections and set-points.",
    ),
    "validation.nothing_filtered": Text(
        "fewer than {limit:.0f} samples of this log have a deflection and a torque once they are filtered; the filter needs"
        " {window} samples in a row without a gap or a missing value.",
        "Record longer, or without the gaps.",
    ),
    "validation.all_outside_region": Text(
        "no sample of this log lies in the region that the model was fitted in, so all its predictions here are extrapolation.",
        "Fit the model on an experiment that covers these deflections and set-points; if it should, a position's sign, unit,"
        " zero or gear ratio is wrong in the rig.",
    ),
    "validation.no_reference": Text(
        "the log has neither a torque sensor nor motor positions and torques with a known inertia, so the model is"
        " compared with a computed torque, not with a measurement.",
        "Name a torque_sensor, or motor_position and motor_torque, in the rig.",
    ),
    "validation.judged_by_residual": Text(
        "there is no independent torque sensor, so transmission {part} is judged by the residual, which depends on the rig's"
        " motor parameters.",
        "A wrong inertia, damping, torque constant or sign of the motor shows here too.",
    ),
    "validation.sum_only": Text(
        "one torque sensor measures the sum of the transmissions, and the verdict is about that sum.",
        "{part} alone may be off where their errors cancel.",
    ),
    "validation.few_independent_samples": Text(
        "the error is correlated for so long that {samples} samples count as {value:.2g} independent ones.",
        "A longer experiment makes the interval more certain.",
    ),
    "validation.whole_cycles_only": Text(
        "the model separates loading from unloading by the loop of whole cycles.",
        "It does not describe partial cycles inside that loop.",
    ),
    "validation.modalities_skipped": Text(
        "the log is long ({value:.0f} samples): its modalities are not compared.", "--modalities asks for it."
    ),
    "error.independent": Text("the error shows no dependence that points to a cause."),
    "error.noise": Text(
        "the error depends on none of the recorded signals and is white: noise of the {reference}, which hides the model's"
        " error.",
        "A sensor with less noise would show more.",
    ),
    "error.not_white": Text(
        "the error is not white: it is correlated over about {samples_alike:.0f} samples, so something is missing in the"
        " model, not"
        " only noise.",
        DIAGNOSE,
    ),
    "error.ambiguous": Text("the error is as well explained by: {others}.", DIAGNOSE),
    "error.resolution": Text(
        "the torque sensor's resolution of {step:.3g} N·m alone explains an error of this size, so no smaller error can be"
        " detected.",
        "A sensor with a finer resolution would show more.",
    ),
    "error.sensor_stuck": Text(
        "the torque sensor stays at one value while the torque goes on, first at {first:.4g} s and for {stuck_share:.3%} of the"
        " log: it is stuck, or its messages are.",
        "Leave that stretch out (--start, --end).",
    ),
    "error.offset": Text(
        "the prediction is {offset:+.3g} N·m off on average: the torque sensor has an offset, or a constant torque is missing.",
        DIAGNOSE,
    ),
    "error.gain": Text(
        "the error grows with the torque: what is measured is {gain:.4g} times what is predicted. The spring is stiffer (above"
        " 1)"
        " or softer (below 1) than in the model, a gear ratio or a unit is wrong, or the torque sensor's gain is.",
        DIAGNOSE,
    ),
    "error.sign": Text(
        "the measured torque is {gain:.2f} times the predicted one: a sign is swapped, of torque or deflection.",
        DIAGNOSE,
    ),
    "error.deflection_zero": Text("the deflection's zero is off: an encoder has an offset.", DIAGNOSE),
    "error.asymmetry": Text(
        "the error has the torque's size whatever its sign: the spring is not alike in both directions (asymmetry).",
        DIAGNOSE,
    ),
    "error.backlash": Text(
        "the error has the sign of the deflection, and its size does not grow with it: backlash.", DIAGNOSE
    ),
    "error.spring_shape": Text(
        "the error depends on the deflection: the spring's shape is not the model's (nonlinearity, asymmetry, backlash).",
        DIAGNOSE,
    ),
    "error.position": Text(
        "the error follows the position of link or motor: a gear ratio or an encoder's scale or sign is off, or its disc is"
        " eccentric.",
        DIAGNOSE,
    ),
    "error.setpoint": Text(
        "the error depends on the set-point: its zero or scale is off (lever arm, secondary motor's encoder), or the model has"
        " too few powers of it.",
        DIAGNOSE,
    ),
    "error.velocity": Text(
        "the error grows with the velocity of the deflection: damping in the transmission, or a sensor that is late.",
        DIAGNOSE,
    ),
    "error.late_encoder": Text(
        "the error grows with a position's velocity: the rig has too little damping or too much, or one encoder is late against"
        " the other.",
        DIAGNOSE,
    ),
    "error.friction": Text(
        "the error has the sign of the velocity: friction or hysteresis is missing; the two sides are {apart:.3g} N·m apart.",
        DIAGNOSE,
    ),
    "error.loading": Text(
        "the error differs between loading and unloading, by {apart:.3g} N·m: the transmission has hysteresis, or a loop of its"
        " mechanism (a cam that switches).",
        DIAGNOSE,
    ),
    "error.drift_of_torque": Text("the error changes over time: the torque sensor drifts.", DIAGNOSE),
    "error.drift_of_encoder": Text("the error changes over time: an encoder drifts.", DIAGNOSE),
    "error.drift_of_gain": Text(
        "the error grows with the torque, and changes over time: the stiffness drifts, or the torque sensor's gain.",
        DIAGNOSE,
    ),
    "channel.missing": Text(
        "there is no channel '{channel}', which the rig names for {part}; the joint was evaluated without it."
    ),
    "channel.misnamed": Text(
        "there is no channel '{channel}', which the rig names for {part}; the joint was evaluated without it.",
        "Did you mean {near}?",
    ),
    "channel.empty": Text(
        "channel '{channel}', which the rig names for {part}, has no row; the joint was evaluated without it."
    ),
    "rig.sign": Text(
        "with the sign of {part} reversed the equations would close some {value:.0f} times better.",
        "Check that in the rig first; no cause was searched for.",
    ),
    "rig.unit": Text(
        "with the unit of {part} corrected, which is recorded {factor:.4g} times too large, the equations would close some"
        " {value:.0f} times better; degrees are 57.3 times as large as radians.",
        "Check that in the rig first; no cause was searched for.",
    ),
    "rig.exchanged": Text(
        "with {part} exchanged the equations would close some {value:.0f} times better.",
        "Check that in the rig first; no cause was searched for.",
    ),
    "diagnosis.joint_left_out": Text("left out: {reason}."),
    "diagnosis.nothing_measured": Text(
        "without a torque that was measured no equation can be checked.", "No cause was searched for."
    ),
    "diagnosis.link_of_chain": Text(
        "the motion of its link depends on the other joints of the chain: it was not judged, and the measured motion was used."
    ),
    "diagnosis.spring_fitted": Text(
        "the rig does not state the type of its spring, so a smooth one was fitted to the log together with the causes, and the"
        " torque at zero deflection was attributed to an offset of {part}, {value:.3g} {unit}.",
        "The diagnosis reports what no smooth spring explains; stiffness itself, its asymmetry, encoders' gains and offsets"
        " were not"
        " judged, nor the torque sensor's offset.",
    ),
    "diagnosis.rig_lacks": Text(
        "the equation '{part}' was not checked, since the rig lacks {key}.",
        "Give it under [joint.{joint}] in the rig, or with --set joint.{joint}.{key}=VALUE.",
    ),
    "diagnosis.equation_unchecked": Text(
        "the equation '{part}' can be formed nowhere in this log, and was not checked."
    ),
    "diagnosis.search_unsettled": Text(
        "started from the reported causes, the search finds others that are about as probable.",
        "Record a longer log or a richer motion.",
    ),
    "diagnosis.simulation_off": Text(
        "though the equations close, the simulation of {part} is off by {value:.3g} times its noise.",
        "Something that the rig lacks moves the joint, or the recorded inputs are incomplete.",
    ),
    "diagnosis.holdout_contradicts": Text(
        "with the causes found the simulation matches the log within its noise, but not the held-out log.",
        "That log is of another machine, the machine was changed, or one log has motions that the other lacks.",
    ),
    "diagnosis.not_simulated": Text("it could not be simulated, so the gain was not measured: {reason}."),
    "identification.misfit": Text(
        "with the identified numbers the simulation of {part}, {where}, is off by {value:.3g} times its noise floor. The"
        " intervals contain noise only, and the numbers may be further off: they compensate what the rig lacks.",
        "'vsalog diagnose LOG' searches for effects that the rig lacks; --free KEY adds a number that is known to be missing.",
    ),
    "identification.worse_elsewhere": Text(
        "with the identified numbers {part} is simulated worse on data that were not fitted, {where}, than with the rig's:"
        " its RMS error is {value:.3g} {unit}, that of the rig {limit:.3g} {unit}.",
        "The fit compensates an effect that the rig lacks: 'vsalog diagnose LOG' searches for it.",
    ),
    "diagnosis.no_experiment": Text("no experiment is proposed: {reason}."),
}


def add_texts(own: Mapping[str, Text]) -> None:
    """Add texts to the catalogue, when the module is imported that makes findings of these codes.

    Parameters
    ----------
    own : code → text

    Raises
    ------
    ValueError
        The catalogue has one of the codes.
    """
    if twice := own.keys() & TEXTS.keys():
        raise ValueError(f"the catalogue of findings has {', '.join(sorted(twice))} already")
    TEXTS.update(own)


class _Words(Formatter):
    """Formats as `str.format` does, counts, and quotes for a shell: `{value:n row}` is "2 rows", `{name:q}` "'my log.csv'"."""

    def format_field(self, value: Any, format_spec: str) -> str:
        if format_spec.startswith("n "):
            return plural(int(value), format_spec[2:])
        if format_spec == "q":
            return quote(str(value))
        return str(super().format_field(value, format_spec))


def says(finding: Finding) -> str:
    """Return what was found, without the advice."""
    return _filled(TEXTS[finding.code].says, finding)


def sentence(finding: Finding, joint: bool = True) -> str:
    """Return what a finding says, and what to do about it; with the joint's name where that is asked for."""
    text = TEXTS[finding.code]
    words = _filled(f"{text.says} {text.advice}".strip(), finding)
    name = f"joint '{finding.joint}'" if finding.joint and joint else ""
    return ": ".join(filter(None, (finding.log, name, words)))


def sentences_of(findings: Iterable[Finding]) -> tuple[str, ...]:
    """Return a sentence per finding; what was found alike of several joints, or runs, is one sentence about all."""
    return tuple(words for _, words in by_severity(findings))


def by_severity(findings: Iterable[Finding]) -> tuple[tuple[Severity, str], ...]:
    """Return the sentences of `sentences_of`, each with its severity."""
    joints: dict[tuple[Severity, str], dict[str, None]] = {}
    for finding in findings:
        own = joints.setdefault((finding.severity, sentence(finding, joint=False)), {})
        own |= {finding.joint: None} if finding.joint else {}
    return tuple((severity, _of_joints(names, words)) for (severity, words), names in joints.items())


def merged(findings: Iterable[Finding]) -> tuple[tuple[Severity, str], ...]:
    """Return sentences for people, each with its severity: one for all that has one cause.

    What a finding explains of the same joint is named behind it, but for what invalidates; what several joints have in
    common but for its numbers is reported once, with the numbers of the first.
    """
    every = list(findings)
    groups, seen = dict[tuple[object, ...], list[Finding]](), Counter[tuple[object, ...]]()
    for finding in every:
        if not any(_may_follow(finding, cause) for cause in every):
            about = (finding.severity, finding.code, finding.log, finding.part)
            # A second one of the same joint is another one.
            seen[about, finding.joint] += 1
            groups.setdefault((*about, bool(finding.joint), seen[about, finding.joint]), []).append(finding)
    out = dict[tuple[Severity, str], None]()
    for alike in groups.values():
        first = alike[0]
        follow = {f.code: None for one in alike for f in every if _may_follow(f, one)}
        words = [_of_joints(dict.fromkeys(f.joint for f in alike if f.joint), sentence(first, joint=False))]
        if len({sentence(f, joint=False) for f in alike}) > 1:
            words.append(f"The numbers are those of joint '{first.joint}'.")
        if follow:
            words.append(f"Other findings may follow from it; to read about them: 'vsalog explain {' '.join(follow)}'.")
        out[first.severity, " ".join(words)] = None
    return tuple(out)


def _may_follow(finding: Finding, cause: Finding) -> bool:
    alike = finding.joint == cause.joint and (finding.log == cause.log or not finding.log or not cause.log)
    return alike and finding.severity != "invalidates" and finding.code in TEXTS[cause.code].explains


def _of_joints(names: Collection[str], words: str) -> str:
    quoted = ", ".join(f"'{name}'" for name in names)
    return f"joint{'s' if len(names) > 1 else ''} {quoted}: {words}" if names else words


def _filled(text: str, finding: Finding) -> str:
    fields = {name: getattr(finding, name) for name in ("joint", "part", "value", "limit", "unit")}
    return _Words().vformat(text, (), fields | dict(finding.evidence))
