"""Thresholds of the decisions of a diagnosis."""


class Limit:
    """Thresholds and settings of each step, with meaning and unit.

    Where no publication is named, a value was chosen on simulated development rigs,
    which count in no published rate (`validation.md`).
    """

    # Decisions, set so that rigs without any effect give `none`.
    # Form error of an effect over its explained error, in every trial: right names
    # leave as much on rigs of other forms, and less parts no lookalikes
    form_error_share = 0.05
    max_explained_error = 2.4  # Error over the floor of a model that explains the data
    min_z = 2.0  # Least z of a comparison with the model without the effect
    min_reduction = min_z * form_error_share  # of the held-out squared error, by that z
    max_misfit = 1.5  # RMS held-out error over the floor where nothing is missing
    floor_misfit = 1.15  # The same of a model at the floor, as far as that is known
    max_fold_spread = 1.0  # Spread of an amplitude between the folds over its mean
    rival_sigmas = 2.0  # A rival within as many standard errors of the winner is a tie

    # Simulation of the rig and priors of its parameters.
    pretension_deviation = 0.1  # Relative, of a pretension that is not measured
    guessed_pretension_deviation = 1.0  # The same of one estimated from the data
    wind_up = 1e-3  # Turn of a motor over which its friction builds up, at first [rad]
    # Standard deviation of a torque sensor's offset, over the RMS of its readings. The
    # offset is bounded by two deviations. A larger one is an effect
    offset_deviation = 0.01
    ratio_deviation = 0.003  # Relative, of the ratio of two pulleys of nominal size
    coarsening = 8  # Factor by which segments and steps are reduced for differences
    min_segments = 8  # Least segments per cable of a simulation
    min_fitted_friction = 1e-3  # Least coefficient of friction from which a fit starts
    max_fitted_friction = 3.5  # Largest that is fitted; cables take 5, some unbalanced
    balance_deviation = 0.03  # Relative, of two cables' friction from their mean
    gain_sigmas = 3.0  # Largest error of a gain over its declared standard deviation
    weight_share = 0.5  # Force of a weight in place of a cable over the pretension
    max_band = 25.0  # Highest frequency compared [Hz]
    rest_angle_deviation = 0.01  # of a spring, unless it is declared [rad]
    max_motion_band = 60.0  # Highest frequency of the angles that are played [Hz]
    min_kept_rate = 250.0  # Least samples per second kept
    # Trials beyond it keep two samples per period of the band, or what their motion
    # needs, where models are so far off that it makes no difference [s]
    long_trial = 12.0
    # RMS distance of an angle from lines between these samples, over its range
    max_missed_motion = 1e-3
    ramp_samples = 20  # Samples of either part of a lead-in, see `records.with_lead_in`
    run_in_travel = 3.0  # Travel before samples count, over that which winds up
    still_sigmas = 3.0  # Movement that counts as none, in deviations of angle noise
    moving_threshold = 1.5  # Distance of an angle followed either way, over the play
    turn_level = 0.3  # Height over the play within which a turn has its level
    records_rest_speed_share = 0.03  # of its usual top speed below which a motor rests
    # Friction times wrap from which on no motion carries the whole cable along
    max_friction_wrap = 100.0
    min_record_samples = 50  # Least samples of a stretch that is used
    max_replays = 48  # Replays of a record that are kept, those used last

    # Checks of the data.
    noise_rest_speed_share = 0.02  # of the usual top speed below which nothing moves
    min_hold_time = 0.2  # A hold is at least so long [s]
    min_period_correlation = 0.98  # of a periodic motion with the next period
    period_tolerance = 0.03  # of its spread by which a motion differs between periods
    repeat_tolerance = 0.15  # share of its spread by which a repeated motion may differ
    max_shift = 20  # samples between the starts of repeats
    # Turns beyond which angles are taken for degrees, unless the unit is declared
    max_joint_turns = 2.0
    max_motor_turns = 8.0
    beyond_stops = 0.3  # of an angle whose zero is not exact [rad]
    locked_range = 0.05  # range of an angle that was held fast [rad]
    # A cable that winds up keeps the joint behind its pulleys; nothing puts it ahead
    max_wind_up = 2.0
    max_lead = 1.3
    impossible_lead = 1.5
    # Logarithm of a ratio whose inverse is another one, and by which it may be missed
    unequal = 0.15
    inverse = 0.1
    unequal_pulleys = 0.15  # The same of a ratio that both angles and torques have
    copy_tolerance = 1e-9  # Share of a motion by which an angle is no copy of another
    min_copied_rows = 100  # Rows in a row that are a copy of others
    max_angle_step = 0.5  # turned at most from one sample to the next [rad]
    overload_ratio = 150.0  # tensions that no scene explains, over its pretension
    signs_settling_share = 0.1  # of the range after which friction has settled
    sliding_speed_share = 0.3  # of the usual speed from which on the cable slides
    min_spread_share = 0.2  # of its spread that a torque must show while sliding
    min_travel = 4.0  # ranges of motion that a power balance needs
    min_angle_correlation = 0.6  # correlation from which on a sign is certain
    min_generated_share = 0.03  # energy gained, as a share of what passes
    large_generated_share = 0.06
    clear_work_share = 0.2  # energy gained, as a share of the net works
    signs_min_trials = 3  # trials in which torques cannot oppose each other by chance
    max_friction_share = 0.6  # of power lost from which on both sides may be driving
    unit_mismatch_ratio = 12.0  # torque ratio over angle ratio: wrong, and mended
    unit_match_ratio = 4.0
    torque_leap_ratio = 300.0  # over torques of other trials, that no load explains
    max_searched_delay = 0.6  # Delays are searched up to this [s]
    max_plausible_delay = 0.15  # Beyond, it is a mistake of the recording [s]
    timing_min_correlation = 0.8  # correlation from which on a lag counts
    max_drift = 0.02  # drifts searched [s/s], and their steps over a trial [s]
    drift_resolution = 0.01
    relevant_drift = 0.03  # change of the delay over a trial that matters [s]
    min_lead_correlation = 0.6  # Least significant correlation of lead and torque
    # Rise of ln(1 / (1 - R²)) of all trials by a delay that makes it certain
    min_late_gain = 0.1
    # Least ln(1 / (1 - R²)) at that delay: play leads as no torque does
    min_late_fit = 1.0
    # Rise, fit and delay [s] of a single trial: friction makes a slow one late as well
    min_own_gain = 0.7
    min_own_fit = 2.0
    min_own_lag = 0.3
    # Share of a torque that the other need not determine; share that is not explained
    collinear = 1e-3
    explained = 0.02

    # Fit of the baseline, noise floor and intervals.
    max_numerical_error = 0.35  # Harmless RMS change by a finer simulation, in floors
    # Harmless change over the RMS error of the model: halved steps show half of it, so
    # 9 % of the squared error is numerical at most, less than any effect takes
    max_numerical_share = 0.15
    max_cable_segments = 64  # Most segments per cable
    max_substeps = 8  # Most simulation steps per sample
    min_draw_share = 0.95  # of draws with a gap, so that its closing has an interval
    min_counted_samples = 100  # Samples that must count
    huber_delta = 3.0  # Deviations beyond which errors count less than their squares
    # Change of a parameter over which derivatives hold: of its logarithm, in scales
    valid_log_change = 0.05
    valid_change = 0.3
    min_change = 0.1  # Least change, over that, along which they can be seen to change
    max_missed_share = 0.3  # of a change's square beyond that before they are retaken
    # Most evaluations of a fit: where the baseline moved far to make up for a missing
    # effect, the way back along a flat valley takes twenty
    fitting_max_evaluations = 30
    relative_tolerance = 1e-3  # Share of the cost by which a fit goes on
    cost_tolerance = 5e-3  # of the cost of a reported fit: a tenth of a deviation
    record_pieces = 12  # Stretches of a record that are held out in turn
    held_share = 0.1  # Motion of a held angle, over the largest in any trial
    trial_folds = 3  # Parts of the trials held out; fewer trials are split in time
    max_log_factor = 7.0  # Logarithm of the largest factor of an interval in proportion
    undetermined_deviation = 1.0  # in units of priors; beyond, the data say less
    new = 1e-3  # Part of a signature's length below which nothing of it is left
    least = 3  # Trials that show their disagreement; of fewer their pieces do
    min_variance_share = 1e-9  # Least reduction of a variance by a part that informs
    noise_draws = 6  # Simulations with resampled angles
    min_floor_share = 1e-3  # Least floor, over the RMS of the channel
    visible_ratio = 3.0  # Size over its standard error where an occasion could show it
    max_relative_width = 2.0  # Widest interval of a relative change that says something
    sigmas = 1.96  # Half width of a normal 95 % interval, in deviations
    normal_median = 0.6745  # Median size of normal noise, in deviations
    nonzero_confidence = 0.95  # with which the sizes of a named effect are not all zero
    # Pretension [N], radius of pulleys [m], length [m] and stiffness [N] of the bench
    tension = 80.0
    radius = 0.05
    length = 2.0
    stiffness = 5e4
    small_share = 3e-4  # of a typical size at which the derivative near 0 is taken
    # Derivative near 0 over the mean one to the typical size beyond which there is
    # none; it is 24 for a square root and 1e-3 for a square
    max_slope_ratio = 15.0
    rounding = 1e-9  # Relative change of torques that another way of solving makes
    prerequisites_min_correlation = 0.8  # of torques that differ in size only
    max_torque_factor = 1.3  # by which a scene may be off, and a unit still shows
    # Squared error over that in another unit, below which other values explain it
    alternative_error_ratio = 0.25
    push_share = 0.95  # of the samples in which a cable pushes; beyond, it is a sign
    off_factor = 3.0  # by which a value of the scene has to be off to be no start
    pretension_off_factor = 2.0  # The same of a pretension; a fit trusts it to 10 %
    max_cost_ratio = 0.8  # Cost, over that of a scene that the data do not contradict
    error_scale = 0.1  # Error that counts as one, over the deviation of the readings
    # Mean squared error, over `error_scale`, up to which estimates are accepted
    max_mean_square = 9.0
    start_values_settling_share = 0.1  # of the travel after which samples count
    start_values_min_samples = 50  # of thinned records; of fewer nothing is estimated
    # RMS error of a second over the noise that effect-free rigs stay below: 6.6 at
    # most. Of eleven rigs of three makes with quick, slow and restful motions
    stretch_limit = 12.0
    trial_limit = 5.0  # The same of a trial: 2.9 at most
    # RMS error of a motor torque known by current, over the motor's fitted friction,
    # which takes any value from -1 to 1 at rest. Ten effect-free recordings, of 0.15 to
    # 0.5 N m that build up over 1 to 20 mrad, reach 1.3 in a second, 0.9 in a trial
    friction_swing = 2.0
    edge_share = 0.03  # Error at the edges of a stretch over its largest
    max_idle_share = 0.1  # Torque of a cable that transmits nothing, over the simulated
    trend_false_alarm_rate = 1e-2  # over all trends that are tested
    min_trend_trials = 4  # Trials from which on a trend can be tested
    min_trend_share = 0.3  # of the error that constants by trial have to take
    missed_sigmas = 2.0  # First-order change that no step reaches where a fit fails
    # Share of the squared error beyond the floor from which on constants by trial
    # without a trend are the verdict; of single hidden effects they take 4 %
    random_share = 0.9
    rival_margin = 0.02  # Share of the error by which another constant may do worse
    # The same share from which on constants without a trend are reported: other effects
    # show more in some trials, too
    unordered_share = 0.5
    min_outlier_trials = 3  # Trials from which one can stand out
    outlier_ratio = 2.0  # Its error over that of the rest fitted without it
    outlier_floor_ratio = 3.0  # Error of a trial that stands out, over the noise floor
    # Error that such a trial may keep with a constant of its own, over that of the
    # rest: one that no constant mends is the model's, the largest in large motions
    max_remaining_ratio = 1.25
    max_exchanged_share = 0.2  # of its error that remains once torques were exchanged
    tilt_grid_points = 8  # Angles that are tried before the best is refined
    # Share of its error by the tuned scene that a contradicting trial keeps; every
    # model leaves a part of a large effect, most where it shows most
    min_remaining_share = 0.3

    # Events.
    event_block = 0.5  # Length of a block [s]
    event_blocks = 16  # Least blocks of a trial, shorter if need be
    max_event_blocks = 40  # Most blocks of a trial, longer if need be
    event_false_alarm_rate = 1e-3  # over all places, signals and trials
    min_event_blocks = 2  # Least blocks of the part and of the rest of a trial
    min_event_freedom = 3  # Least degrees of freedom of the scatter
    # of a signal's largest square by block, and by trial, to count
    min_event_share = 1e-3
    min_trial_share = 0.02
    max_event_rest = 0.5  # Share of its squared error that an event may leave
    # Share of the squared error beyond which no effect is compared
    sure_event_share = 0.9
    rival_event_share = 0.95  # Squared error left, over that by another constant
    # Relative half width of a size's interval by the form of the model
    event_form_error = 0.01
    min_event_change = 0.05  # Least relative change of a gain or constant
    max_tried_events = 4  # Most parts that are fitted without
    max_events = 5  # Most that are found

    # Search.
    lookalike_cosine = 0.9  # beyond which screening cannot distinguish two signatures
    max_z = 6.0  # Largest z that odds are given for
    max_refitted = 6  # Most candidates that are refitted by simulation in one round
    min_leader_share = 0.15  # of the leader's explained error, to be refitted
    min_rival_share = 0.5  # The same of a rare effect that resembles an accepted one
    min_predicted_share = 0.3  # Predicted reduction over the acceptance threshold
    max_effects = 4  # Most effects that are added
    max_model_change = 0.1  # Relative change of torques that leaves changes the same
    min_square_share = 1e-9  # of a signature below which nothing of it is left
    min_split_trials = 4  # Trials that can be parted
    agreement_share = 0.9  # Share of the parts that must name what is called missing
    tie_share = 0.5  # Least share of the parts whose effect in its place is tied
    max_refinement_share = 0.1  # of the squared gap, of an effect that mends a form
    finding_error = 5.0  # Own RMS error in floors that is a finding all the same

    # Verdict.
    min_clarity = 3.0  # Size over its uncertainty at which a planned trial shows it
    max_prior_sigmas = 3.0  # beyond which a tuned parameter contradicts its prior
    # Deviation of the joint's zero where the arm of the cable depends on it [rad]
    zero_angle_deviation = 0.03
    unit_tolerance = 0.25  # Difference of logarithms at which a wrong unit matches
    hidden_clarity = 5.0  # Untuned RMS change of a hidden effect over the least seen
    max_size_ratio = 30.0  # Largest size that is reported, over its plausible size
    # Share of the RMS error beyond the floor that named effects have to take, or else
    # the gap, in which large errors do not count less: an effect that shows in few
    # moments only closes the gap without taking that share
    min_explained_share = 0.5
    # Share of the gap that an effect must close which takes less, or stays far off
    min_gap_closed = 2.0 / 3.0
    # Error over the floor below which a name is a hint: rigs whose bends and friction
    # are laid out otherwise than the scene's reach that without any effect
    hint_error = 1.8
    # Discrepancy of effects whose forms meet, over the error before the round (m)
    meeting_form_share = 0.25
    # Names on study rigs that left more than `max_explained_error`, right ones and all
    # (`validation.md`), which count by the rule of succession, (k + 1) / (n + 2)
    far_off_right = 4
    far_off_names = 4
    min_shown = 0.02  # Least probability of an alternative that is listed

    # Location of the error.
    explained_error = 1.5  # Error over the floor up to which a torque is explained
    layout_error = 1.8  # Error that the layout of a rig can make, see `hint_error`
    min_searched_error = 1.15  # Error over the floor where structure is looked for
    dominant_ratio = 3.0  # Squared error beyond the floor of one torque over the other
    min_constant_share = 0.5  # Least share of a constant that is reported
    min_constant_sigmas = 5.0  # Least size of such a constant over its standard error
    location_min_blocks = 4  # Stretches of a second from which on one is looked for
    samples_per_period = 2.5  # of the highest frequency of the errors
    # Probability that data without any period show one, over all orders that are tried
    false_alarm_rate = 1e-3
    min_error_share = 0.05  # on samples to which a period was not fitted
    min_periods = 3.0  # within the range; fewer are a smooth function of the angle
    max_order = 250.0  # Highest order [periods per turn]
    order_oversampling = 4  # Orders tried per order that the range resolves
    background_orders = 10  # on either side by which the spectrum there is known
    min_background_orders = 2  # Least resolved orders on a side by which it is known
    clip_sigmas = 3.0  # Deviations beyond which an error counts no more than this
    decision_sigmas = 3.0  # by which one amplitude has to fit better than the other

    # Learned curves.
    curve_points = 25  # of a table, which part a bump of 8 % of the range
    ranked_points = 13  # the same where candidates are ranked
    period_points = 8  # the same of one period
    curve_edge = 0.005  # Share of the samples beyond either end of a table
    # Squares of bends, of steps and of values between points that count as much as the
    # mean square of the samples, times the penalty that predicts best
    curve_bends = 1.0
    curve_steps = 0.3  # so that a table holds its value where training data end
    curve_ridge = 1e-3
    curve_penalties = (1e-4, 1e-3, 1e-2, 1e-1)  # tried
    first_penalty = 1e-2  # where candidates are ranked
    curve_folds = 4  # Parts of the training trials left out in turn
    min_curve_groups = 4  # Trials, not repeated, from which on curves are learned
    max_curves = 3  # Most curves
    refined_curves = 4  # Candidates tried with every penalty and side
    max_waves = 400  # Most periods of a quantity that are tried
    # Widths of formulas that are tried, over a curve's range
    formula_widths = 0.02, 0.03, 0.045, 0.07, 0.1, 0.16
    shape_steps = 0.2, 0.1, 0.05  # of a formula's width, by which its shape is refined
    formula_ridge = 1e-6  # Penalty of a formula's amplitude
    # Share of the gap that is left, on trials not used, below which curves are refused
    min_learned_share = 1.0 / 3.0
    learned_evaluations = 6  # Most of the fit of a model with curves
    learned_travel = 0.1  # up to which travel since a motor turned is known [rad]
    # Share of the largest torque over which the direction of a torque turns
    learned_turn = 0.02

    # Proposed trials.
    decisive_sigmas = 5.0  # Difference, over noise and form, that settles a tie
    searched_trials = 2  # Kinds of trials whose settings are searched
    sure_share = 0.5  # of the expected difference with which a trial settles for sure
    min_gain = 1.05  # Squared separation per second from which a setting is changed
    # Factors by which a search changes one setting at a time
    setting_steps = 2.0, 2.0, 1.4
    default_torque_noise = 0.005  # where none is declared, over the RMS
    default_angle_noise = 1e-4  # where none is declared [rad]
    max_slack = 0.05  # Share of a trial in which a lone cable may be slack
    default_reach = 0.8  # Angle of the motor to either side without a limit [rad]
    default_speed = 3.0  # Default of the motor's largest speed [rad/s]

    # Data without a motor angle or without a torque.
    loss_min_blocks = 6  # Blocks of sliding that either direction must have
    moving_share = 0.05  # of its usual top speed from which on the joint moves
    min_load_spread = 0.1  # Deviation of the load over its mean; below, it is constant
    min_speed_range = 2.0  # Fast over slow from which a drag can be distinguished
    min_own_share = 0.1  # of a column that no other has, from which it is fitted
    settled = 0.03  # Relative excess of the loss at which the cable slides
    settling_margin = 1.5  # Travel that does not count, over that to `settled`
    max_settling_share = 0.6  # of the usual stroke that may pass before it slides
    min_reversals = 8  # Reversals from which a break-away loss is estimated
    min_share = 0.02  # Loss, over the usual load, from which it counts
    min_excess = 0.05  # Break-away loss, over that of sliding, from which it counts
    min_friction_change = 0.1  # Relative, from the scene, that is reported
    max_lag = 0.2  # Largest lag that is fitted [s]
    motion_min_samples = 100  # Samples that must count
    # Range of motion, over a first estimate of the play, from which samples count:
    # before, where the joint lies within its play is not known
    range_over_play = 3.0

    # Dead zone of the pull. Travel over two steps of the pull over the usual one, in
    # nine passages of ten: 2.4 at most without one, 3.4 at least on a brake with one
    passage = 0.15, 0.85  # of the range of the pull
    passage_levels = 15  # of the pull in that range
    min_passages = 3  # from one side to the other
    dead_zone_ratio = 3.0

    # Report.
    max_excerpt = 6.0  # Length of an excerpt, if the trial is as long [s]
    confused_cosine = 0.9  # Cosine above which two effects are called confounded
    min_visible_size = 1.0  # Size over noise below which an effect is too small
    # Width of every figure [inch]: text can be read where the page is 390 px wide
    figure_width = 4.8
    concentrated_share = 0.5  # of the error that the worst trials make together
    sufficient_share = 0.8  # of the error of an effect that suffices by itself

    # Repaired scene.
    probe_inertia = 1e-6  # of the body whose torque measures an acceleration [kg m^2]
    no_input = 16  # `ctrlspec` of `input="none"`, which adds no element to `ctrl`
    rehearsal_swing = 0.3  # of the joint in the rehearsal [rad]
    drive_armature = 1e8  # Armature that makes a joint go where it is driven [kg m^2]
