"""Seeded defects: mistakes that people make in filters, each with the test that must notice it.

An entry changes one text, which occurs exactly once in its file, into another. The list is a test of the
tests: a defect that survives shows a law that nobody checks. `run.py` applies them, one at a time, to a copy.
"""

from typing import NamedTuple


class Defect(NamedTuple):
    """``text`` in src/pendulab/``file`` becomes ``instead``; ``test`` (below tests/) fails then."""

    what: str
    file: str
    text: str
    instead: str
    test: str


FILTERS = "laws/test_filters.py::"
MORE = "laws/test_more_filters.py::"
RANDOM = "laws/test_properties.py::"

STRAIGHT = "laws/test_straight.py::"
SLIDES = "replications/test_ukfslides.py::"
REPORT = "replications/test_muzaffari2024.py::"
DEFECTS = [
    # ------------------------------------------------------------------------------------- predictions
    Defect(
        "Kalman: the prediction forgets Q",
        "kalman.py",
        'symmetrised(sandwich(F, P) + as_matrix("Q", Q, belief.n))',
        "symmetrised(sandwich(F, P))",
        FILTERS + "test_kalman_is_batch_least_squares",
    ),
    Defect(
        "EKF: the prediction forgets Q",
        "ekf.py",
        'symmetrised(sandwich(F, P) + as_matrix("Q", Q, belief.n))',
        "symmetrised(sandwich(F, P))",
        FILTERS + "test_ekf_equals_kf_on_linear_model_with_full_Q",
    ),
    Defect(
        "EKF: Q enters twice",
        "ekf.py",
        'as_matrix("Q", Q, belief.n))',
        '2 * as_matrix("Q", Q, belief.n))',
        RANDOM + "test_every_filter_is_the_kalman_filter_on_every_linear_model",
    ),
    Defect(
        "EKF: Fᵀ P F for F P Fᵀ",
        "ekf.py",
        "sandwich(F, P)",
        "sandwich(F.mT, P)",
        FILTERS + "test_ekf_equals_kf_on_linear_model_with_full_Q",
    ),
    Defect(
        "EKF: the Jacobian is taken at the state after the step",
        "ekf.py",
        "    x, F = model.tangent(x, u)\n",
        "    x = model.step(x, u)\n    F = model.jacobian(x, u)\n",
        "laws/test_equations.py::test_eq_ekf_predict_cov",
    ),
    Defect(
        "EKF: the input is forgotten",
        "ekf.py",
        "model.tangent(x, u)",
        "model.tangent(x)",
        FILTERS + "test_ekf_equals_kf_on_linear_model_with_full_Q",
    ),
    Defect(
        "EKF: the predicted covariance is not symmetrised",
        "ekf.py",
        'symmetrised(sandwich(F, P) + as_matrix("Q", Q, belief.n))',
        '(sandwich(F, P) + as_matrix("Q", Q, belief.n))',
        STRAIGHT + "test_covariances_of_the_filter_itself_are_symmetric_to_the_last_bit",
    ),
    Defect(
        "UKF: the prediction forgets Q",
        "ukf.py",
        'weighted_outer(wc, dX, dX) + as_matrix("Q", Q, belief.n)',
        "weighted_outer(wc, dX, dX)",
        FILTERS + "test_ukf_equals_kf_on_linear_model_with_full_Q",
    ),
    Defect(
        "UKF: the input meets runs instead of points",
        "ukf.py",
        "np.asarray(u)[..., None, :]",
        "np.asarray(u)",
        RANDOM + "test_batch_is_a_loop_on_linear_models",
    ),
    Defect(
        "UKF: deviations of the points are not wrapped",
        "ukf.py",
        "dX = angles.residual(X, x[..., None, :], model.is_angle)",
        "dX = X - x[..., None, :]",
        MORE + "test_model_that_wraps_its_angles_changes_nothing_but_turns",
    ),
    Defect(
        "square root: the prediction forgets Q",
        "square_root_ukf.py",
        'noise = semidefinite_factors(as_matrix("Q", Q, belief.n))',
        'noise = 0.0 * semidefinite_factors(as_matrix("Q", Q, belief.n))',
        MORE + "test_square_root_ukf_equals_kf_on_linear_model_with_full_Q",
    ),
    # ----------------------------------------------------------------------------------------- updates
    Defect(
        "the gain is transposed",
        "linalg.py",
        "return T(solve_factored(L, T(C)))",
        "K = T(solve_factored(L, T(C)))\n    return T(K) if K.shape[-1] == K.shape[-2] else K",
        RANDOM + "test_every_filter_is_the_kalman_filter_on_every_linear_model",
    ),
    Defect(
        "the correction has the wrong sign",
        "kalman.py",
        "posterior = Gaussian.trusted(x + matvec(K, innovation), corrected)",
        "posterior = Gaussian.trusted(x - matvec(K, innovation), corrected)",
        FILTERS + "test_kalman_is_batch_least_squares",
    ),
    Defect(
        "Joseph's form loses K R Kᵀ",
        "kalman.py",
        "symmetrised(sandwich(I_KH, P) + sandwich(K, R))",
        "symmetrised(sandwich(I_KH, P))",
        FILTERS + "test_kalman_is_batch_least_squares",
    ),
    Defect(
        "the short form in place of Joseph's",
        "kalman.py",
        "symmetrised(sandwich(I_KH, P) + sandwich(K, R))",
        "symmetrised(product(I_KH, P))",
        FILTERS + "test_joseph_form_survives_where_the_short_form_fails",
    ),
    Defect(
        "S lacks R",
        "kalman.py",
        "S = symmetrised(sandwich(H, P) + R)",
        "S = symmetrised(sandwich(H, P) + 1e-9 * R)",
        FILTERS + "test_kalman_is_batch_least_squares",
    ),
    Defect(
        "UKF: half of K S Kᵀ is subtracted",
        "kalman.py",
        "symmetrised(P - product(K, T(C)))",
        "symmetrised(P - 0.5 * product(K, T(C)))",
        FILTERS + "test_ukf_equals_kf_on_linear_model_with_full_Q",
    ),
    Defect(
        "the innovation is ẑ − z",
        "sensors/protocol.py",
        "return angles.residual(z, z_hat, self.is_angle)",
        "return angles.residual(z_hat, z, self.is_angle)",
        FILTERS + "test_kalman_is_batch_least_squares",
    ),
    Defect(
        "mixed cross covariance: fresh measurement points with the old state points",
        "ukf_no_redraw.py",
        "Z = sensor.h(X)",
        "Z = sensor.h(points.points(belief))",
        MORE + "test_ukf_without_redraw_is_the_kf_whose_noise_comes_after_the_measurement",
    ),
    Defect(
        "UKF: cross covariance about the mean of something else",
        "ukf.py",
        "dX = X - belief.mean[..., None, :]",
        "dX = X - 0.9 * belief.mean[..., None, :]",
        "laws/test_equations.py::test_eq_ukf_posterior",
    ),
    Defect(
        "UKF: S with the weights of means",
        "ukf.py",
        "weighted_outer(wc, dZ, dZ) + sensor.R",
        "weighted_outer(wm, dZ, dZ) + sensor.R",
        "laws/test_equations.py::test_eq_ukf_measurement",
    ),
    Defect(
        "UKF: S lacks R",
        "ukf.py",
        "weighted_outer(wc, dZ, dZ) + sensor.R",
        "weighted_outer(wc, dZ, dZ) + 1e-9 * sensor.R",
        FILTERS + "test_ukf_equals_kf_on_linear_model_with_full_Q",
    ),
    Defect(
        "UKF: deviations of measured angles are not wrapped",
        "ukf.py",
        "dZ = angles.residual(Z, z_hat[..., None, :], sensor.is_angle)",
        "dZ = Z - z_hat[..., None, :]",
        MORE + "test_bearing_across_the_cut_is_the_bearing_across_the_front_turned_by_half",
    ),
    Defect(
        "iterated EKF: the measurement is used again in every iteration",
        "iterated_ekf.py",
        "last = linear_update(belief, y, H, sensor.R, seen)",
        "last = ekf.update(last.posterior, z, sensor)",
        MORE + "test_iterations_leave_a_linear_posterior_unchanged",
    ),
    Defect(
        "iterated EKF: the innovation is not carried back to the prediction",
        "iterated_ekf.py",
        "sensor.residual(z, sensor.h(x)) - matvec(H, belief.mean - x)",
        "sensor.residual(z, sensor.h(x))",
        RANDOM + "test_every_filter_is_the_kalman_filter_on_every_linear_model",
    ),
    Defect(
        "iterated EKF: the Jacobian stays at the predicted state",
        "iterated_ekf.py",
        "H = sensor.jacobian(x)",
        "H = sensor.jacobian(belief.mean)",
        MORE + "test_iterations_end_at_the_most_probable_state",
    ),
    Defect(
        "square root: the update forgets the noise of the sensor",
        "square_root_ukf.py",
        'wc, K @ noise, "corrected state covariance"',
        'wc, 0 * K @ noise, "corrected state covariance"',
        MORE + "test_square_root_ukf_equals_kf_on_linear_model_with_full_Q",
    ),
    Defect(
        "square root: a negative weight is added",
        "square_root_ukf.py",
        "added = rows[..., 1:, :] if weights[0] < 0 else rows",
        "added = rows",
        MORE + "test_square_root_ukf_equals_ukf_on_a_curved_sensor",
    ),
    # ------------------------------------------------------------------------ missing, runs, likelihood
    Defect(
        "a missing component counts as measured in the gain",
        "kalman.py",
        "C * seen[..., None, :], cholesky",
        "C, cholesky",
        RANDOM + "test_missing_component_is_a_sensor_without_it",
    ),
    Defect(
        "wrong degrees of freedom: missing components count in the density's constant",
        "kalman.py",
        "count = y.shape[-1] if seen is None else np.sum(seen, axis=-1)",
        "count = y.shape[-1]",
        FILTERS + "test_missing_component_equals_a_sensor_without_it",
    ),
    Defect(
        "log-likelihood with half the log-determinant",
        "kalman.py",
        "(nis + log_det(factor) + count * _LOG_2PI)",
        "(nis + 0.5 * log_det(factor) + count * _LOG_2PI)",
        FILTERS + "test_sum_of_log_likelihoods_is_the_log_density_of_all_measurements",
    ),
    Defect(
        "NIS of the innovation that is not whitened",
        "kalman.py",
        "nis = squared_length(solve_lower(factor, innovation[..., None])[..., 0])",
        "nis = squared_length(innovation)",
        FILTERS + "test_log_likelihood_and_nis_of_one_update_are_those_of_the_innovation",
    ),
    Defect(
        "wrong degrees of freedom of an averaged χ²",
        "consistency.py",
        "gammaincinv(dof * averaged / 2, tails)",
        "gammaincinv(dof / 2, tails)",
        "laws/test_consistency.py::test_chi2_band_holds_its_probability_by_integration_and_by_drawing",
    ),
    Defect(
        "errors of angles take the long way round",
        "consistency.py",
        "return angles.residual(truth, mean, mask)",
        "return truth - mean",
        "laws/test_consistency.py::test_errors_take_the_short_way_round_where_states_are_angles",
    ),
    # ----------------------------------------------------------------------------- sigma points, circle
    Defect(
        "weights aliased: the covariance weights overwrite those of the means",
        "sigma_points.py",
        "wc = wm.copy()",
        "wc = wm",
        "laws/test_sigma_points.py::test_weights_sum_to_what_the_theory_says",
    ),
    Defect(
        "sigma points along the rows of the factor",
        "sigma_points.py",
        'product(offsets, T(cholesky(P, "state covariance")))',
        'product(offsets, cholesky(P, "state covariance"))',
        "laws/test_sigma_points.py::test_points_carry_mean_and_covariance",
    ),
    Defect(
        "spread α (n + κ) for α² (n + κ)",
        "sigma_points.py",
        "offsets = np.sqrt(spread) * np",
        "offsets = np.sqrt(spread / alpha) * np",
        "laws/test_sigma_points.py::test_points_carry_mean_and_covariance",
    ),
    Defect(
        "cubature points at √(n + 1)",
        "sigma_points.py",
        "offsets = np.sqrt(n) * np",
        "offsets = np.sqrt(n + 1) * np",
        MORE + "test_named_sets_are_members_of_the_scaled_family",
    ),
    Defect(
        "the circle has half its circumference",
        "angles.py",
        "return angle - 2 * np.pi * np.rint(angle / (2 * np.pi))",
        "return angle - np.pi * np.rint(angle / np.pi)",
        RANDOM + "test_wrapped_angle_is_the_same_angle_within_half_a_turn",
    ),
    Defect(
        "degrees for radians",
        "angles.py",
        "return angle - 2 * np.pi * np.rint(angle / (2 * np.pi))",
        "return angle - 360 * np.rint(angle / 360)",
        STRAIGHT + "test_whole_turns_of_a_measured_angle_change_nothing",
    ),
    Defect(
        "residuals of angles are not wrapped",
        "angles.py",
        "for i in np.flatnonzero(is_angle):\n        turns",
        "for i in ():\n        turns",
        STRAIGHT + "test_whole_turns_of_a_measured_angle_change_nothing",
    ),
    Defect(
        "residuals of recorded angles are not wrapped",
        "angles.py",
        "_wrap_unknown(difference[..., i])",
        "difference[..., i]",
        FILTERS + "test_whole_turns_of_state_or_measurement_change_nothing",
    ),
    Defect(
        "everything is wrapped, rates as well",
        "angles.py",
        "if is_angle[i] and not -np.pi",
        "if not -np.pi",
        RANDOM + "test_residual_leads_from_one_angle_to_the_other_the_short_way",
    ),
    Defect(
        "plain mean of angles",
        "angles.py",
        "residual(points, centre, is_angle)",
        "points - centre",
        "laws/test_sigma_points.py::test_mean_turns_with_its_points_and_ignores_whole_turns",
    ),
    # ------------------------------------------------------------------------------- steps and systems
    Defect(
        "RK4: the last stage at half a step",
        "discretize.py",
        "k4 = rate(s + dt * k3)",
        "k4 = rate(s + dt / 2 * k3)",
        "laws/test_discretize.py::test_global_error_falls_with_the_order_of_the_method",
    ),
    Defect(
        "RK4: a weight of 2 lost",
        "discretize.py",
        "k1 + 2 * (k2 + k3) + k4",
        "k1 + 2 * k2 + k3 + k4",
        "laws/test_equations.py::test_eq_rk4",
    ),
    Defect(
        "symplectic Euler: positions with the old velocities",
        "discretize.py",
        "s[..., position, :] + dt * new[..., velocity, :]",
        "s[..., position, :] + dt * s[..., velocity, :]",
        "laws/test_discretize.py::test_symplectic_euler_preserves_area_on_the_simple_pendulum_and_not_on_the_"
        "double_pendulum",
    ),
    Defect(
        "the tangent is I + dt A whatever the step",
        "discretize.py",
        "return Tangent(both[..., 0, :], both[..., 1:, :])",
        "return Tangent(both[..., 0, :], np.eye(self.n) + self.dt * self.system.jacobian_x(x, u))",
        RANDOM + "test_tangent_is_the_derivative_of_the_step",
    ),
    Defect(
        "the input's Jacobian forgets how the state carries the input on",
        "discretize.py",
        "changes = A @ s[:, 1:]",
        "changes = A @ (s[:, 1:] * (not du.any()))",
        "laws/test_discretize.py::test_input_jacobian_is_the_derivative_of_the_step_itself",
    ),
    Defect(
        "first-order hold: beginning and end of the step exchanged",
        "linear_model.py",
        "[held - gained, gained]",
        "[gained, held - gained]",
        "laws/test_discretisations.py::test_first_order_hold_follows_a_ramp_for_ever_and_zero_order_hold_falls_"
        "behind",
    ),
    Defect(
        "white acceleration: dt² for dt²/2",
        "noise.py",
        "q[..., i] * dt**2 / 2",
        "q[..., i] * dt**2",
        "laws/test_discretize.py::test_white_acceleration_equals_van_loans_matrix_exponential",
    ),
    Defect(
        "input noise: standard deviations for variances",
        "noise.py",
        "symmetrised(G @ Pu @ T(G))",
        "symmetrised(G @ np.sqrt(Pu) @ T(G))",
        "laws/test_noise.py::test_input_noise_is_G_Pu_G_transposed",
    ),
    # ------------------------------------------------------------------------------------ time and order
    Defect(
        "off by one: the track updates before it predicts for the first time",
        "track.py",
        "for stage, noise in moves[k]:",
        "for stage, noise in moves[k] if k else ():",
        FILTERS + "test_kalman_is_batch_least_squares",
    ),
    Defect(
        "off by one: the input of the next step",
        "track.py",
        "us[..., k, :]",
        "us[..., min(k + 1, steps - 1), :]",
        FILTERS + "test_kalman_is_batch_least_squares",
    ),
    Defect(
        "the track goes on from the prediction",
        "track.py",
        "*covariances), update.posterior",
        "*covariances), predicted",
        FILTERS + "test_kalman_is_batch_least_squares",
    ),
    Defect(
        "off by one: simulate looks before it moves",
        "simulate.py",
        "        x = model.step(x, u) + rng.standard_normal((*lead, model.n)) @ process.T\n"
        "        truth[..., k, :] = x\n",
        "        truth[..., k, :] = x\n"
        "        x = model.step(x, u) + rng.standard_normal((*lead, model.n)) @ process.T\n",
        "laws/test_simulate.py::test_entry_k_belongs_to_time_k_plus_one",
    ),
    Defect(
        "simulate draws with the covariance for its factor",
        "linalg.py",
        "            L[j, j] = np.sqrt(pivot)\n",
        "            L[j, j] = pivot\n",
        "laws/test_simulate.py::test_increments_have_covariance_Q_and_measurement_errors_R",
    ),
    Defect(
        "the smoother takes the input of the step before",
        "smooth.py",
        "None if us is None else us[..., k + 1, :], bridge",
        "None if us is None else us[..., k, :], bridge",
        "laws/test_smooth.py::test_smoother_is_batch_least_squares_on_a_linear_model",
    ),
    Defect(
        "the smoother forgets what a state keeps to itself",
        "smooth.py",
        "P = symmetrised(D + G @ P @ T(G))",
        "P = symmetrised(G @ P @ T(G))",
        "laws/test_smooth.py::test_smoother_is_batch_least_squares_on_a_linear_model",
    ),
    Defect(
        "stale R: an adaptive scheme learns and does not use it",
        "adaptive/scheme.py",
        "update = self.filter.update(predicted, z, replace(sensor, R=memory.R), **options)",
        "update = self.filter.update(predicted, z, sensor, **options)",
        "laws/test_adaptive.py::test_R_is_found_from_a_start_that_is_wrong_by_ten",
    ),
    Defect(
        "stale Q: an adaptive scheme predicts with the caller's",
        "adaptive/windowed.py",
        "memory.degrees[..., None, None] * Q, u",
        "Q, u",
        "laws/test_adaptive.py::test_scale_of_Q_is_found",
    ),
    Defect(
        "the residual's covariance with the wrong sign",
        "adaptive/scheme.py",
        "symmetrised(outer(residual) + sandwich(H, P))",
        "symmetrised(outer(residual) - sandwich(H, P))",
        "laws/test_adaptive.py::test_R_is_found_from_a_start_that_is_wrong_by_ten",
    ),
    Defect(
        "a range without its root",
        "sensors/landmarks.py",
        "r = np.hypot(east, north)",
        "r = east**2 + north**2",
        "laws/test_sensors.py::test_range_and_bearing_of_places_that_are_known",
    ),
    Defect(
        "the bearing does not turn with the heading",
        "sensors/landmarks.py",
        "H[..., 1::2, self.heading] = -1.0",
        "H[..., 1::2, self.heading] = 1.0",
        "laws/test_sensors.py::test_jacobian_of_range_and_bearing_by_complex_steps_of_its_definition",
    ),
    Defect(
        "the grid takes the ringing of its splines for a density",
        "grid.py",
        "if not before.flat[p.argmax()] > floor:",
        "if not before.max() > 0:",
        "laws/test_corners.py::test_grid_refuses_a_measurement_that_only_its_own_error_explains",
    ),
    # --------------------------------------------------------------------------------- straight lines
    Defect(
        "a kept covariance takes the entries of another",
        "straight.py",
        "self.where = [x, n + P,",
        "self.where = [x, P,",
        STRAIGHT + "test_straight_line_filter_is_the_filter_itself",
    ),
    Defect(
        "a straight line goes on over a missing measurement",
        "straight.py",
        "if certain:",
        "if True:",
        STRAIGHT + "test_missing_components_are_left_to_the_filter_itself",
    ),
    Defect(
        "rows that wait are written one step late",
        "straight.py",
        "            self.start = k\n",
        "            self.start = k + (k > 0)\n",
        STRAIGHT + "test_any_number_of_steps",
    ),
    Defect(
        "a pivot of zero passes for positive",
        "codegen.py",
        "if pivot > 0 else math.nan",
        "if pivot >= 0 else math.nan",
        STRAIGHT + "test_covariance_without_a_dimension_is_refused_or_taken_as_by_the_filter_itself",
    ),
    Defect(
        "a zero in the Jacobian leaves a one",
        "unroll.py",
        "        if _is(other, 0):\n            return 0\n        return self if _is(other, 1)",
        "        if _is(other, 0):\n            return 1\n        return self if _is(other, 1)",
        STRAIGHT + "test_recorded_step_is_the_method_run_on_numbers",
    ),
    Defect(
        "a name is free before its last use",
        "unroll.py",
        "if last[name] <= i]",
        "if last[name] <= i + 1]",
        STRAIGHT + "test_recorded_step_is_the_method_run_on_numbers",
    ),
    Defect(
        "the last block of many states is left out",
        "bound.py",
        "for i in range(0, lead[axis], length)",
        "for i in range(0, lead[axis] - length + 1, length)",
        STRAIGHT + "test_one_by_one_together_and_in_blocks_are_the_same",
    ),
    Defect(
        "sine and cosine of half the angle",
        "codegen.py",
        "return t * share, share - 1",
        "return 0.5 * t * share, share - 1",
        STRAIGHT + "test_one_by_one_together_and_in_blocks_are_the_same",
    ),
    Defect(
        "noise that depends on the state is taken at the prior for ever",
        "track.py",
        "Q = timeline.at(noise, stage, predicted.mean, u)",
        "Q = timeline.at(noise, stage, prior.mean, u)",
        "laws/test_state_noise.py::test_noise_of_state_and_input_is_that_of_a_loop_by_hand",
    ),
    Defect(
        "the likelihood of a block with Q and R exchanged",
        "adaptive/by_likelihood.py",
        "q, r = scales.T[..., None, None]",
        "r, q = scales.T[..., None, None]",
        "laws/test_adaptive.py::test_both_scales_are_found_together_by_the_likelihood",
    ),
    # ------------------------------------------------------------------------------------ replications
    Defect(
        "slides: the mixed cross covariance is put right",
        "replications/ukfslides.py",
        "dX = predicted.points - predicted.mean[..., None, :]",
        "dX = points.points(predicted) - predicted.mean[..., None, :]",
        SLIDES + "test_mixed_points_leave_a_velocity_uncorrected_after_a_diagonal_covariance",
    ),
    Defect(
        "slides: a negative eigenvalue is taken by its size before the root",
        "replications/ukfslides.py",
        "roots = np.emath.sqrt(values)",
        "roots = np.sqrt(np.abs(values))",
        SLIDES + "test_complex_points_are_refused_where_the_listing_goes_on",
    ),
    Defect(
        "the report's EKF linearises its step after all",
        "replications/muzaffari2024.py",
        'says that this is right.\n    """\n    return model.system.jacobian_x(after, u)',
        'says that this is right.\n    """\n    return model.jacobian(before, u)',
        REPORT + "test_replica_of_the_ekf_is_the_listing",
    ),
    Defect(
        "the report's AUKF leaves ε out of Q",
        "replications/muzaffari2024.py",
        "model, self._more(memory.Q), u",
        "model, memory.Q, u",
        REPORT + "test_replica_of_the_aukf_is_the_listing_with_functions_of_the_latest_innovation",
    ),
    Defect(
        "the report's AUKF shows its functions the oldest innovations for ever",
        "replications/muzaffari2024.py",
        "(*memory.innovations, update.innovation)[-self.window :]",
        "(*memory.innovations, update.innovation)[: self.window]",
        REPORT + "test_guessed_window_is_the_mean_square_of_the_latest_innovations",
    ),
    Defect(
        "the report's table: the data of a level begin with the sample that the filter starts from",
        "replications/muzaffari2024.py",
        "for first in range(1, len(states), _PIECE):",
        "for first in range(0, len(states), _PIECE):",
        REPORT + "test_table_is_the_rmse_of_one_track_with_the_first_sample_counted_as_known",
    ),
    Defect(
        "straight lines draw the points of another root",
        "straight.py",
        " and type(points) is PointSet",
        "",
        SLIDES + "test_points_of_the_slides_serve_the_right_filter_alone_and_among_many",
    ),
]
