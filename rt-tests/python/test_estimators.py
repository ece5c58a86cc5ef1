"""crates/estimators and crates/identification against scipy, scikit-learn and filterpy.

The example `estimators_json` of `identification` computes what it is asked to.
"""

import math
from fractions import Fraction

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter, JulierSigmaPoints, UnscentedKalmanFilter
from processes import example, json_program
from scipy.signal import savgol_coeffs
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel


@pytest.fixture(scope="module")
def ours():
    return json_program(example("estimators_json"))


def test_savitzky_golay_coefficients(ours):
    # scipy solves a Vandermonde system in unscaled time: orders and windows at which it is
    # itself exact to 1e-12; longer ones below.
    filters = [
        (window, order, derivative, delay)
        for window, order in [(2, 1), (5, 2), (8, 3), (7, 4), (25, 2), (40, 1), (80, 2), (80, 1)]
        for derivative in range(min(order, 2) + 1)
        for delay in [0.0, 0.5 * (window - 1), 0.25 * (window - 1), 0.1]
    ]
    answer = ours(savgol=filters)["coefficients"]
    for (window, order, derivative, delay), h in zip(filters, answer, strict=True):
        theirs = savgol_coeffs(window, order, deriv=derivative, pos=window - 1 - delay, use="dot")
        np.testing.assert_allclose(h, theirs, rtol=0, atol=1e-12, err_msg=f"{window} {order} {derivative} {delay}")


@pytest.mark.parametrize("window, order", [(81, 3), (81, 5), (200, 4)])
@pytest.mark.parametrize("derivative", [0, 1, 2])
def test_savitzky_golay_coefficients_beyond_the_precision_of_scipy(ours, window, order, derivative):
    delay = Fraction(1, 4)
    h = ours(savgol=[(window, order, derivative, float(delay))])["coefficients"][0]
    times = [Fraction(i) for i in range(window)]
    read_at = window - 1 - delay
    # Normal equations of the polynomial fit, solved exactly.
    sums = [sum(t**k for t in times) for k in range(2 * order + 1)]
    a = [[sums[i + j] for j in range(order + 1)] for i in range(order + 1)]
    b = [math.perm(k, derivative) * read_at ** (k - derivative) if k >= derivative else Fraction(0) for k in range(order + 1)]
    for i in range(order + 1):
        for k in range(i + 1, order + 1):
            factor = a[k][i] / a[i][i]
            a[k] = [x - factor * y for x, y in zip(a[k], a[i], strict=True)]
            b[k] -= factor * b[i]
    c = [Fraction(0)] * (order + 1)
    for i in reversed(range(order + 1)):
        c[i] = (b[i] - sum(a[i][j] * c[j] for j in range(i + 1, order + 1))) / a[i][i]
    exact = [float(sum(c[k] * t**k for k in range(order + 1))) for t in times]
    np.testing.assert_allclose(h, exact, rtol=0, atol=1e-12)


@pytest.mark.parametrize("dimensions", [3, 4, 6, 9])
@pytest.mark.parametrize("noise", [1e-4, 1e-2])
def test_gaussian_process(ours, dimensions, noise):
    rng = np.random.default_rng(dimensions)
    points = rng.uniform(-2, 2, (150, dimensions))
    residuals = np.sin(points[:, 0]) + 0.3 * points[:, 1] ** 2 + math.sqrt(noise) * rng.normal(size=150)
    widths = rng.uniform(0.7, 3, dimensions)
    signal = 0.8
    queries = rng.uniform(-3, 3, (60, dimensions))
    answer = ours(
        gp={
            "points": points.tolist(),
            "residuals": residuals.tolist(),
            "widths": widths.tolist(),
            "signal_variance": signal,
            "noise_variance": noise,
            "queries": queries.tolist(),
        }
    )
    kernel = ConstantKernel(signal) * RBF(widths) + WhiteKernel(noise)
    regressor = GaussianProcessRegressor(kernel, optimizer=None, alpha=0.0).fit(points, residuals)
    value, gradient = regressor.log_marginal_likelihood(kernel.theta, eval_gradient=True)
    # Theirs: constant, widths, noise.
    gradient = [*gradient[1:-1], gradient[0], gradient[-1]]
    assert answer["log_marginal_likelihood"] == pytest.approx(value, rel=1e-8)
    np.testing.assert_allclose(answer["gradient"], gradient, rtol=1e-8, atol=1e-8 * np.abs(gradient).max())
    mean, deviation = regressor.predict(queries, return_std=True)
    # Theirs is a noisy sample's variance.
    theirs = np.column_stack([mean, deviation**2 - noise])
    np.testing.assert_allclose(answer["predicted"], theirs, rtol=1e-8, atol=1e-8)


JOINT = {
    "gear_ratio": 100.0,
    "torque_limit": 40.0,
    "sample_period": 1e-3,
    "k_fs0": 8333.0,
    "c_fs": 0.089,
    "k_wg0": 1.33,
    "c_wg": 83.5,
    "torque_constant": 0.05,
    "friction": 0.015,
    "viscous_friction": 1e-5,
    "rotor_inertia": 1.14e-5,
    "sign_smoothing": 2.0,
    "error_link": 7e-5,
    "error_motor": 3e-5,
}
PROCESS = [1e-7, 2.0, 0.05, 100.0, 1e-9]
MEASUREMENT = [3e-6, 4e-10]


def recording(count):
    """Loaded motion with noisy encoders and current: q, theta, dq, omega, current."""
    rng = np.random.default_rng(5)
    t = 1e-3 * np.arange(count)
    q, dq = 0.8 * np.sin(1.7 * t), 1.36 * np.cos(1.7 * t)
    tau = 11 * np.sin(2.9 * t) + 2 * np.cos(7 * t)
    torsion = np.arctan(JOINT["c_fs"] * tau) / JOINT["c_fs"] / JOINT["k_fs0"] + 7e-5 * np.sin(q)
    theta = 100 * (q + torsion) + 2e-3 * rng.normal(size=count)
    current = tau / 5 + 0.3 * np.sign(dq) + 0.03 * rng.normal(size=count)
    return np.column_stack([q + 5e-6 * rng.normal(size=count), theta, dq, 100 * dq, current])


def process(x, dt, tau_m):
    """U's reconstruction, models' section 5, a second implementation."""
    theta, omega, tau = x
    friction = JOINT["viscous_friction"] * omega + JOINT["friction"] * np.tanh(omega / JOINT["sign_smoothing"])
    alpha = (tau_m - friction - tau / JOINT["gear_ratio"]) / JOINT["rotor_inertia"]
    return np.array([theta + dt * omega, omega + dt * alpha, tau])


def measured(x):
    tau_wg = x[2] / JOINT["gear_ratio"]
    flexspline = np.arctan(JOINT["c_fs"] * x[2]) / (JOINT["c_fs"] * JOINT["k_fs0"])
    wave_generator = np.sign(tau_wg) * (1 - np.exp(-JOINT["c_wg"] * abs(tau_wg))) / (JOINT["c_wg"] * JOINT["k_wg0"])
    return np.array([x[0], flexspline + wave_generator / JOINT["gear_ratio"]])


def torsion(sample):
    q, theta = sample[:2]
    error = JOINT["error_link"] * np.sin(q) + JOINT["error_motor"] * np.cos(theta)
    return theta / JOINT["gear_ratio"] - q - error


def start(kalman, sample):
    angle = JOINT["c_fs"] * JOINT["k_fs0"] * torsion(sample)
    kalman.x = np.array([sample[1], sample[3], np.tan(angle) / JOINT["c_fs"]])
    kalman.P = np.diag([1e-2, 1e2, (0.1 * JOINT["torque_limit"]) ** 2])
    kalman.Q = np.diag(PROCESS[:3])
    kalman.R = np.diag(MEASUREMENT)


def compare(ours, theirs):
    """State, standard deviation of tau, normalised innovation: to 1e-8 of each one's range."""
    ours, theirs = np.array(ours), np.array(theirs)
    assert ours.shape == theirs.shape
    scale = np.abs(theirs).max(axis=0)
    np.testing.assert_array_less(np.abs(ours - theirs).max(axis=0), 1e-8 * scale)


def row(kalman):
    y, s = kalman.y, kalman.S
    return [*kalman.x, math.sqrt(kalman.P[2, 2]), float(y @ np.linalg.solve(s, y))]


@pytest.fixture(scope="module")
def filtered(ours):
    samples = recording(3000)
    return samples, ours(
        kalman={"joint": JOINT, "process": PROCESS, "measurement": MEASUREMENT, "samples": samples.tolist()}
    )


def without_inflation(rows):
    """Undoes the increase of our sigma where innovations exceed their expectation over a second."""
    rows, mean = np.array(rows), 2.0
    for r in rows:
        mean += (min(r[4], 1e6) - mean) * JOINT["sample_period"]
        r[3] /= math.sqrt(max(mean / 2, 1))
    return rows


def test_unscented_filter(filtered):
    samples, answer = filtered
    # kappa = 0: no weight on the centre, the points at sqrt(3) sigma.
    points = JulierSigmaPoints(3, kappa=0)
    ukf = UnscentedKalmanFilter(3, 2, JOINT["sample_period"], measured, process, points)
    theirs = []
    for i, sample in enumerate(samples):
        if i == 0:
            start(ukf, sample)
            ukf.sigmas_f = points.sigma_points(ukf.x, ukf.P)
        else:
            ukf.predict(tau_m=JOINT["torque_constant"] * sample[4])
            ukf.P = 0.5 * (ukf.P + ukf.P.T)
            ukf.sigmas_f = points.sigma_points(ukf.x, ukf.P)
        ukf.update(np.array([sample[1], torsion(sample)]))
        ukf.P = 0.5 * (ukf.P + ukf.P.T)
        theirs.append(row(ukf))
    compare(without_inflation(answer["unscented"]), theirs)


def test_linear_filter(filtered):
    samples, answer = filtered
    dt, n = JOINT["sample_period"], JOINT["gear_ratio"]
    ekf = ExtendedKalmanFilter(3, 2)
    h = np.array([[1, 0, 0], [0, 0, 1 / JOINT["k_fs0"]]])
    theirs = []
    for i, sample in enumerate(samples):
        if i == 0:
            start(ekf, sample)
        else:
            slope = 1 - np.tanh(ekf.x[1] / JOINT["sign_smoothing"]) ** 2
            friction = JOINT["viscous_friction"] + JOINT["friction"] * slope / JOINT["sign_smoothing"]
            per_inertia = dt / JOINT["rotor_inertia"]
            f = np.array([[1, dt, 0], [0, 1 - per_inertia * friction, -per_inertia / n], [0, 0, 1]])
            ekf.x = process(ekf.x, dt, JOINT["torque_constant"] * sample[4])
            ekf.P = f @ ekf.P @ f.T + ekf.Q
        ekf.update(np.array([sample[1], torsion(sample)]), lambda x: h, lambda x: h @ x)
        theirs.append(row(ekf))
    compare(without_inflation(answer["linear"]), theirs)
