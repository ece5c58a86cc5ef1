"""Torque against reference, from a recording: what the robot was asked for, what it did, and how sure that is.

    python plot_recording.py run.mcap --joint knee -o knee.svg

Cell by cell (# %%) as a notebook where the editor knows that, as VS Code, Spyder or `jupytext` do. Needs PyPI's numpy
and matplotlib, and torquectl, which computes what a recording of frames does not hold.
"""

# %% Which recording
import argparse
import csv
import os
import subprocess

import matplotlib

matplotlib.use(os.environ.get("MPLBACKEND", "svg"))
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402

arguments = argparse.ArgumentParser(description="Plots a joint's torque against its reference.")
arguments.add_argument("run", help="a recording by torqued or torquectl record")
arguments.add_argument("--joint", required=True, help="the joint's name")
arguments.add_argument("-o", "--output", default="torque.svg", help="the picture, .svg, .png or .pdf")
asked = arguments.parse_args()

# %% The signals as columns: the fields that `torquectl export --list RUN` shows
fields = "stamp_ns,state,tau_hat,tau_d,tau_star,commanded.joints"
command = [os.environ.get("TORQUECTL", "torquectl"), "export", asked.run, "--fields", fields]
table = subprocess.run(command, check=True, capture_output=True, text=True).stdout
titles, *rows = csv.reader(table.splitlines())
cells = np.array([[float(cell or "nan") for cell in row] for row in rows])
column = dict(zip([title.split(" [")[0] for title in titles], cells.T))
unit = next(t for t in titles if t.startswith(f"estimated.joints[{asked.joint}].tau_hat.tau ")).split("[")[-1].rstrip("]")
t = column["time"]
tau = column[f"estimated.joints[{asked.joint}].tau_hat.tau"]
sigma = column[f"estimated.joints[{asked.joint}].tau_hat.sigma"]
reference = column[f"commanded.joints[{asked.joint}].tau_d"]
valid = column[f"estimated.joints[{asked.joint}].tau_hat.flags"].astype(int) & 1 == 1

# %% What the robot followed: from the first desired torque on
following = valid & (reference != 0.0)
error = tau[following] - reference[following]
rms = float(np.sqrt(np.mean(error**2))) if error.size else float("nan")
within = float(np.mean(np.abs(error) < 2.0 * sigma[following])) if error.size else float("nan")
print(f"{asked.joint}: {following.sum()} cycles with a desired torque, RMS of tau_hat - tau_d {rms:.2f} {unit}, "
      f"{100.0 * within:.0f} % within two sigma")

# %% The picture
figure, (above, below) = plt.subplots(2, 1, sharex=True, figsize=(9.0, 5.5), height_ratios=[2, 1])
shown = np.where(valid, tau, np.nan)
above.fill_between(t, shown - 2.0 * sigma, shown + 2.0 * sigma, alpha=0.25, linewidth=0, label="two sigma")
above.plot(t, shown, linewidth=1.0, label="tau_hat: estimated, without delay")
above.plot(t, reference, linewidth=1.0, label="tau_d: reference")
above.set_ylabel(f"torque in {unit}")
above.legend(loc="upper right", fontsize="small")
below.plot(t, np.where(following, tau - reference, np.nan), linewidth=1.0, color="tab:red")
below.set_ylabel(f"tau_hat - tau_d in {unit}")
below.set_xlabel("time since the first cycle in s")
figure.suptitle(f"{asked.joint}: torque against reference")
figure.tight_layout()
figure.savefig(asked.output)
print(f"{asked.output}: written")
