"""Thresholds of the decisions of a diagnosis."""


class Limit:
    """Thresholds and settings of each step, with meaning and unit.

    Where no publication is named, a value was set on development rigs of the study,
    which count in no published rate (`validation.md`).
    """

    # Decisions, set so that rigs without any effect give `none`.
    # Form error of an effect over its explained error, in every trial: right names
    # leave that much on rigs of other forms. A smaller difference does not exclude a
    # lookalike
    form_error_share = 0.05
    # Error over the floor up to which a model explains the data, part by part
    max_explained_error = 2.4
    min_z = 2.0  # Least z of a comparison with the model without the effect
    # Least relative reduction of the held-out squared error that this z allows
    min_reduction = min_z * form_error_share
    # RMS held-out error over the floor below which nothing is missing
    max_misfit = 1.5
    # The same at which a model is at the floor, as far as that is known
    floor_misfit = 1.15
    # Largest spread of the amplitude between the folds over its mean
    max_fold_spread = 1.0
    rival_sigmas = 2.0  # A rival within as many standard errors of the winner is a tie

    # Simulation of the rig and priors of its parameters.
    # Relative standard deviation of a pretension that is not measured
    pretension_deviation = 0.1
    # Relative standard deviation of a pretension that is estimated from the data
    guessed_pretension_deviation = 1.0
    # Turn of a motor over which its friction builds up, where a fit starts [rad]
    wind_up = 1e-3
    # Standard deviation of a torque sensor's offset, over the RMS of its readings. The
    # offset is bounded by two deviations. A larger one is an effect
    offset_deviation = 0.01
    # Relative standard deviation of the ratio of two pulleys of nominal size
    ratio_deviation = 0.003
    # Factor by which segments and steps of a simulation are reduced for differences
    coarsening = 8
    min_segments = 8  # Least segments per cable of a simulation
    # Smallest coefficient of friction from which a fit starts
    min_fitted_friction = 1e-3
    # Largest coefficient of friction that is fitted; cables take 5, some unbalanced
    max_fitted_friction = 3.5
    # Standard deviation of the difference of two cables' friction, relative
    balance_deviation = 0.03
    gain_sigmas = 3.0  # Largest error of a gain over its declared standard deviation
    motion_duration = 40.0  # Length of a motion
    # Time over which a triangle is rounded where it turns [s]
    turn_rounding_time = 0.03
    # Change of the tensions over the pretension where an end is held: none goes slack
    max_tension_change = 0.8
    # Force of a known weight in place of a cable over the pretension
    weight_share = 0.5
    max_band = 25.0  # Highest frequency compared [Hz]
    # Standard deviation of the angle at which a spring rests, unless declared [rad]
    rest_angle_deviation = 0.01
    max_motion_band = 60.0  # Highest frequency of the angles that are played [Hz]
    min_kept_rate = 250.0  # Least samples per second kept
    ramp_samples = 20  # Samples of either part of a lead-in, see `replays.with_lead_in`
    # Travel of the motor before samples count, over the travel that winds up the cable
    run_in_travel = 3.0
    # Movement that counts as none, in deviations of the angle's noise
    still_sigmas = 3.0
    # Distance of the angle followed either way, over the play, that only motion makes
    moving_threshold = 1.5
    turn_level = 0.3  # Height over the play within which a turn has its level
    # Share of its usual top speed below which a motor rests
    records_rest_speed_share = 0.03
    # Friction times wrap from which on no motion carries the whole cable along
    max_friction_wrap = 100.0
    min_record_samples = 50  # Least samples of a stretch that is used
    max_replays = 48  # Replays of a record that are kept, those used last

    # Checks of the data.
    # Share of the range by which a motion must come back to be a reversal
    reversal_share = 0.02
    # share of the usual top speed below which nothing moves
    noise_rest_speed_share = 0.02
    min_hold_time = 0.2  # A hold is at least so long [s]
    # correlation of a periodic motion with the next period
    min_period_correlation = 0.98
    # Share of its spread by which a motion may differ from period to period
    period_tolerance = 0.03
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
    copy_tolerance = 1e-9  # Share of a motion by which an angle is no copy of another
    min_copied_rows = 100  # Rows in a row that are a copy of others
    min_clip_length = 5  # samples at an extreme that are one clipped stretch
    max_angle_step = 0.5  # turned at most from one sample to the next [rad]
    overload_ratio = 150.0  # tensions that no scene explains, over its pretension
    # share of the range of motion after which friction has settled
    signs_settling_share = 0.1
    # Share of the usual speed from which on the cable surely slides
    sliding_speed_share = 0.3
    # Share of its spread that a torque must show while the cable slides
    min_spread_share = 0.2
    min_travel = 4.0  # ranges of motion that a power balance needs
    min_angle_correlation = 0.6  # correlation from which on a sign is certain
    min_generated_share = 0.03  # energy gained, as a share of what passes
    large_generated_share = 0.06
    clear_work_share = 0.2  # energy gained, as a share of the net works
    signs_min_trials = 3  # trials in which torques cannot oppose each other by chance
    # Share of the power lost from which on both sides may be driving
    max_friction_share = 0.6
    unit_mismatch_ratio = 12.0  # ratios of angles to torques that are wrong, and right
    unit_match_ratio = 4.0
    # Torques of one trial over those of the others that no load explains
    torque_leap_ratio = 300.0
    max_searched_delay = 0.6  # Delays are searched up to this [s]
    # A delay beyond this is a mistake of the recording, not an effect [s]
    max_plausible_delay = 0.15
    timing_min_correlation = 0.8  # correlation from which on a lag counts
    max_drift = 0.02  # drifts searched [s/s], and their steps over a trial [s]
    drift_resolution = 0.01
    relevant_drift = 0.03  # change of the delay over a trial that matters [s]
    # Least significant correlation of lead and torque
    min_lead_correlation = 0.6
    # Time over which rates are averaged, so that noise of the lead does not dominate
    # [s]
    rate_window = 0.05
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
    # RMS change by a finer simulation, over the noise floor, that is harmless
    max_numerical_error = 0.35
    # Harmless change over the RMS error of the model. Halved steps show half of an
    # error of first order, so at most 9 % of the squared error is numerical, less than
    # any effect takes
    max_numerical_share = 0.15
    max_cable_segments = 64  # Most segments per cable
    max_substeps = 8  # Most simulation steps per sample
    # Relative uncertainty of a pretension from which more than one start is tried
    multistart_uncertainty = 0.3
    multistart_factors = (0.1, 0.3, 3.0)  # Such starts, over the value that was given
    # Share of draws with a gap to close from which on its closing has an interval
    min_draw_share = 0.95
    min_counted_samples = 100  # Samples that must count
    # Errors beyond this many deviations of noise count less than their squares
    huber_delta = 3.0
    # Change of a parameter over which derivatives hold: of its logarithm, in scales
    valid_log_change = 0.05
    valid_change = 0.3
    min_change = 0.1  # Least change, over that, along which they can be seen to change
    # Share of a change's square that they may miss beyond that before they are retaken
    max_missed_share = 0.3
    # Most evaluations of a fit: where the baseline moved far to make up for a missing
    # effect, the way back along a flat valley takes twenty
    fitting_max_evaluations = 30
    relative_tolerance = 1e-3  # Share of the cost by which a fit goes on
    # Most fits of a corrected coarse simulation in place of one of a fine one
    max_corrections = 4
    # Tolerance of the cost of a reported fit: a tenth of a standard deviation
    cost_tolerance = 5e-3
    record_pieces = 12  # Stretches of a record that are held out in turn
    # Motion of an angle, over the largest in any trial, below which it was held
    held_share = 0.1
    # Parts of the trials that are held out in turn; fewer trials are split in time
    trial_folds = 3
    max_log_factor = 7.0  # Logarithm of the largest factor of an interval in proportion
    # Deviation in units of priors from which on the data say less than was known
    undetermined_deviation = 1.0
    new = 1e-3  # Part of a signature's length below which nothing of it is left
    # Least number of trials that show their disagreement; of fewer their pieces do
    least = 3
    # Least reduction of a variance by a part that informs a parameter, relative
    min_variance_share = 1e-9
    noise_draws = 6  # Simulations with resampled angles
    smoothing_time = 0.04  # Time over which the scatter is taken together [s]
    min_floor_share = 1e-3  # Least floor, over the RMS of the channel
    # Band of the movements that are put back, over that of the angles that are played
    slow = 1.0 / 6.0
    # Share of them: some slow movements are noise, and most of them where readings are
    # rounded. On rigs without effects this makes the floor equal to the error of
    # readings
    put_back = 0.5
    # Band of the likely motion where the angle is well under way, the same
    smooth = 1.0 / 5.0
    pace = 4.0  # Way within `window` from which an angle is under way, over the play
    window = 0.05  # [s]
    # Time for which an angle has to move throughout; where it rests, smoothing would
    # start it early, to which a sticking cable would respond [s]
    clear = 0.2
    # Least shared size over the standard error on an occasion that could show it
    visible_ratio = 3.0
    absent = 1e-6  # Place of a fit below which a size is 0
    max_relative_width = 2.0  # Widest interval of a relative change that says something
    # Half width of a 95 % interval of a normal distribution, in deviations
    sigmas = 1.96
    # Probability with which the sizes of a named effect are not all zero
    nonzero_confidence = 0.95
    # Pretension [N], radius of pulleys [m], length [m] and stiffness [N] of the bench
    tension = 80.0
    radius = 0.05
    length = 2.0
    stiffness = 5e4
    # Share of a typical size at which the derivative near 0 is taken, over as much
    small_share = 3e-4
    # Derivative near 0 over the mean one to the typical size beyond which there is
    # none; it is 24 for a square root and 1e-3 for a square
    max_slope_ratio = 15.0
    # Change of the torques over their size that another way of solving makes, too
    rounding = 1e-9
    max_checked_records = 3  # Records on which effects are checked
    # Correlation from which on measured and simulated torque differ in size only
    prerequisites_min_correlation = 0.8
    # Factor up to which a scene may be off in torque, and a unit or a sign still shows
    max_torque_factor = 1.3
    # Squared error over that of the scene in another unit, from which on other values
    # of the scene are the explanation
    alternative_error_ratio = 0.25
    # Share of the samples in which a cable pushes from which on it is a sign
    push_share = 0.95
    # Factor by which a value of the scene has to be off to be no start
    off_factor = 3.0
    # Factor by which the pretension has to be off; a fit trusts the scene's to 10 %
    pretension_off_factor = 2.0
    # Cost, over that of the scene, from which on the data contradict the scene
    max_cost_ratio = 0.8
    thinned_step = 0.04  # Time between the samples of a thinned record [s]
    # Error that counts as one, over the standard deviation of the readings
    error_scale = 0.1
    # Mean squared error, over `error_scale`, up to which estimates are accepted. No
    # estimate explains torques of the opposite sign
    max_mean_square = 9.0
    # Share of a record's travel after which its beginning no longer counts
    start_values_settling_share = 0.1
    friction_grid = (0.01, 0.03, 0.1, 0.3, 1.0, 3.0)  # Friction times wrap on the grid
    # Stiffness on the grid, over that of the line
    stiffness_grid = (0.25, 0.5, 1.0, 2.0, 4.0)
    # Pretension on the grid, over the usual tension that readings show
    pretension_grid = (0.1, 0.3, 1.0, 3.0, 10.0)
    # Least share of a lever's arm at 0, and wrap [rad], that are divided by
    min_arm = 0.1
    min_wrap = 0.1
    # Samples of thinned records below which nothing is estimated
    start_values_min_samples = 50
    refined_points = 3  # Points of the grid from which fits start
    # RMS error of a second over the noise that effect-free rigs stay below: 6.6 at
    # most. Of eleven rigs of three makes with quick, slow and restful motions
    stretch_limit = 12.0
    # RMS error of a trial over the noise that the same rigs stay below: 2.9 at most
    trial_limit = 5.0
    # RMS error of a motor torque known by current, over the motor's fitted friction. At
    # rest that friction takes any value from -1 to 1, so the error is 2 at most. Ten
    # effect-free recordings, with frictions of 0.15 to 0.5 N m that build up over 1 to
    # 20 mrad, reach 1.3 in a second and 0.9 in a trial
    friction_swing = 2.0
    edge_window = 0.1  # Time over which the edges of a stretch are found [s]
    bridged = 1.0  # Time of small errors within a stretch [s]
    # Error at the edges of a stretch over its largest, at least half of the limit
    edge_share = 0.03
    # Torque of a cable that transmits nothing, over what it should be
    max_idle_share = 0.1
    # Probability that trials without a trend show one, over all that is tested
    trend_false_alarm_rate = 1e-2
    min_trend_trials = 4  # Trials from which on a trend can be tested
    # Share of the squared error beyond the floor that constants by trial have to take
    min_trend_share = 0.3
    max_fitted = 2  # Parameters that are fitted by simulation, the best to first order
    # First-order change, in standard errors, that no step reaches where a fit fails
    missed_sigmas = 2.0
    # Damping of a step that is tried, relative to the diagonal (Marquardt 1963)
    dampings = (0.0, 1e-3, 0.03, 1.0)
    # Share of the squared error beyond the floor from which on constants by trial
    # without a trend are the verdict; of single effects that are hidden in rigs they
    # take 4 %
    random_share = 0.9
    # Share of the squared error by which another constant may do worse and is given
    rival_margin = 0.02
    # Least share of the squared error beyond the floor of reported constants per trial
    # without a trend: other effects show more in some trials, too
    unordered_share = 0.5
    min_outlier_trials = 3  # Trials from which one can stand out
    # Error of a trial that stands out, over that of the rest fitted without it
    outlier_ratio = 2.0
    outlier_floor_ratio = 3.0  # Error of a trial that stands out, over the noise floor
    max_suspects = 2  # Trials that are left out in turn, the worst first
    # Error that such a trial may keep with a constant of its own, over that of the
    # rest: an error that no constant mends is one of the model, and is largest where
    # the motion is largest
    max_remaining_ratio = 1.25
    # Share of its error that a trial keeps at most whose torques were exchanged
    max_exchanged_share = 0.2
    # Angles around the joint's axis that are tried before the best is refined
    tilt_grid_points = 8
    # Share of its error by the tuned scene that a contradicting trial keeps; every
    # model leaves a part of a large effect, most where it shows most
    min_remaining_share = 0.3

    # Search.
    # Cosine beyond which screening cannot distinguish two signatures
    lookalike_cosine = 0.9
    bootstrap_draws = 400  # Block bootstraps
    max_z = 6.0  # Largest z that odds are given for
    max_refitted = 6  # Most candidates that are refitted by simulation in one round
    # Share of the leader's explained error that a candidate needs to be refitted
    min_leader_share = 0.15
    # The same of a rare effect that resembles an accepted one
    min_rival_share = 0.5
    # Least predicted reduction of a candidate, relative to the acceptance threshold
    min_predicted_share = 0.3
    max_effects = 4  # Most effects that are added
    # Relative change of the torques up to which the changes by an effect are the same
    max_model_change = 0.1
    max_models = 3  # Models of which the changes of a record are kept, those used last
    # Part of a signature's square below which nothing of it is left
    min_square_share = 1e-9
    min_split_trials = 4  # Trials that can be parted
    agreement_share = 0.9  # Share of the parts that must name what is called missing
    # Least share of the parts whose effect in its place is tied with it
    tie_share = 0.5
    # Share of the squared gap below which an effect may only mend the form of another
    max_refinement_share = 0.1
    # RMS error of its own over the floor from which on it is a finding all the same
    finding_error = 5.0

    # Verdict.
    # Smallest ratio of size to uncertainty at which a planned trial shows an effect
    min_clarity = 3.0
    # Threshold of visibility: squared RMS change by a plausible effect, in noise
    # floors. At the floor, such an effect explains as much of the error as acceptance
    # requires
    min_visible_change = 0.1
    # Prior standard deviations beyond which a tuned parameter contradicts its prior
    max_prior_sigmas = 3.0
    # Standard deviation of the joint's zero where the cable's arm depends on it [rad].
    # On a pulley the arm is the same for every zero
    zero_angle_deviation = 0.03
    # Largest difference of logarithms at which a stiffness matches a wrong unit
    unit_tolerance = 0.25
    # Smallest untuned RMS change of a hidden effect, over the threshold of visibility
    hidden_clarity = 5.0
    # Largest size of an effect that is reported, over its plausible size
    max_size_ratio = 30.0
    # Share of the RMS error beyond the floor that named effects have to take, or else
    # the gap. In the search large errors count less, since few moments must not decide
    # what is named; an effect that shows in few moments only closes the gap without
    # taking that share
    min_explained_share = 0.5
    # Share of the gap between RMS errors that an effect has to close which takes less
    # than `min_explained_share`, or stays far off
    min_gap_closed = 2.0 / 3.0
    # Error over the floor below which a name is a hint: rigs whose bends and friction
    # are laid out otherwise than the scene's reach that without any effect
    hint_error = 1.8
    # Discrepancy of effects whose forms meet, a weight and a spring, over the error
    # before the round (m)
    meeting_form_share = 0.25
    # Names on study rigs that left more than `MAX_EXPLAINED_ERROR`, those that were
    # right and all of them, see `validation.md`. So few count by the rule of
    # succession, (k + 1) / (n + 2)
    far_off_right = 4
    far_off_names = 4
    min_shown = 0.02  # Least probability of an alternative that is listed

    # Location of the error.
    # Error over the noise floor up to which a torque counts as explained; that of rigs
    # from which nothing is missing
    explained_error = 1.5
    # Error over the noise floor that the layout of a rig can make, see `hint_error`
    layout_error = 1.8
    # Error over the noise floor from which on a structure is looked for
    min_searched_error = 1.15
    # Squared error beyond the floor of one torque over that of the other, from which on
    # it is mostly in that torque
    dominant_ratio = 3.0
    # Least share of the squared error of a constant that is reported
    min_constant_share = 0.5
    min_constant_sigmas = 5.0  # Least size of such a constant over its standard error
    # Stretches of about a second from which on a constant is looked for
    location_min_blocks = 4
    # Samples per period of the highest frequency of the errors
    samples_per_period = 2.5
    # Probability that data without any period show one, over all orders that are tried
    false_alarm_rate = 1e-3
    # Least share of the squared error, on samples to which a period was not fitted
    min_error_share = 0.05
    # Least periods within the range of the angle: fewer are a smooth function of it
    min_periods = 3.0
    max_order = 250.0  # Highest order [periods per turn]
    # Orders that are tried per order that the range of the angle resolves
    order_oversampling = 4
    # Resolved orders on either side by which the spectrum there is known
    background_orders = 10
    min_background_orders = 2  # Least resolved orders on a side by which it is known
    clip_sigmas = 3.0  # Deviations beyond which an error counts no more than this
    # Standard errors by which one amplitude has to fit better than the other
    decision_sigmas = 3.0

    # Proposed trials.
    # Difference over its standard deviation, by noise and form, that settles it
    decisive_sigmas = 5.0
    # Correlation with a motion from which on a trial is one of it
    min_motion_correlation = 0.9
    # Standard deviation of a torque's noise where none is declared, over its RMS
    default_torque_noise = 0.005
    # Standard deviation of an angle's noise where none is declared [rad]
    default_angle_noise = 1e-4
    # Share of a trial in which a lone cable may be slack: nothing is transmitted there
    max_slack = 0.05
    # Angle of the motor to either side where the scene does not limit the joint [rad]
    default_reach = 0.8
    default_speed = 3.0  # Default of the motor's largest speed [rad/s]

    # Data without a motor angle or without a torque.
    loss_min_blocks = 6  # Blocks of sliding that either direction must have
    min_block_time = 0.25  # Shortest block that a long stroke is divided into [s]
    # Speed from which the joint moves, as a share of its usual top speed
    moving_share = 0.05
    # Standard deviation of the load over its mean, below which it is constant
    min_load_spread = 0.1
    # Ratio of fast to slow from which a drag can be distinguished
    min_speed_range = 2.0
    # Share of a column's variance that no other column has, from which it is fitted
    min_own_share = 0.1
    # Excess of the loss over that of sliding at which the cable slides, relative
    settled = 0.03
    # Travel that does not count, over that from which the excess is so small
    settling_margin = 1.5
    # Largest share of the usual stroke that may pass before the cable slides
    max_settling_share = 0.6
    min_reversals = 8  # Reversals from which a break-away loss is estimated
    min_share = 0.02  # Loss, over the usual load, from which it counts
    min_excess = 0.05  # Break-away loss, over that of sliding, from which it counts
    # Relative deviation of friction from the scene that is reported
    min_friction_change = 0.1
    max_lag = 0.2  # Largest lag that is fitted [s]
    motion_min_samples = 100  # Samples that must count
    # Range of motion, over a first estimate of the play, from which samples count:
    # before, where the joint lies within its play is not known
    range_over_play = 3.0

    # Report.
    max_excerpt = 6.0  # Length of an excerpt, if the trial is as long [s]
    confused_cosine = 0.9  # Cosine above which two effects are called confounded
    # Size over noise below which an effect is called too small to be seen
    min_visible_size = 1.0
    # Width of every figure [inch]: text can be read where the page is 390 px wide
    figure_width = 4.8
    matrix_width = 7.2  # Width of the folded matrix of effects, which scrolls [inch]
    # Place of the labels of an excerpt, in widths of a panel from its left side
    label_place = -0.13
    max_maps = 4  # Maps that are drawn; others are mentioned
    legend_share = 0.12  # Room for it, before the curves, over the time that they take
    # Share of the squared error beyond noise that the worst trials make together
    concentrated_share = 0.5
    # Least share of the error of an effect that suffices by itself
    sufficient_share = 0.8

    # Repaired scene.
    # Inertia of the body whose torque measures an acceleration [kg m^2]
    probe_inertia = 1e-6
    # Damping ratio of a pulley within its play, on the cables alone
    play_damping = 0.02
    phase_index = 2  # Index of the ripple's phase in the bias parameters of a DC motor
    # `ctrlspec` of an actuator with `input="none"`, which adds no element to `ctrl`
    no_input = 16
    rehearsal_swing = 0.3  # of the joint in the rehearsal [rad]
    torque_tolerance = 1e-3  # of the largest torque
    drive_armature = 1e8  # Armature that makes a joint go where it is driven [kg m^2]
    # Deviation of a time step from the mean that is still even, relative
    step_tolerance = 1e-3
