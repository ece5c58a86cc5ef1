/* Rigid bodies of a plane: three links that turn about y, a foot on the third. Lagrange's equations in the
 * links' angles against the vertical, in which the mass matrix needs no recursion. */
#include "robot.h"

#include <math.h>

#define GRAVITY 9.81
/* The foot hangs on the sensor, which is below the ankle. */
#define SENSOR_Z (-0.06)
#define FOOT_MASS 1.4
#define FOOT_X 0.02
#define FOOT_Z (-0.03)
#define FOOT_INERTIA 0.005

const struct sheet SHEET[JOINTS] = {
    {"hip", 100, 0.10, 1.4e-4, 32000, 8, 120, 0.05, 4e-5, 0.3, 18000, 220, 14, 0.03, 6, -2.3, 1.0, -0.5,
     0, 0, 5.0, 0.01, -0.15, 0.06},
    {"knee", 120, 0.09, 9e-5, 40000, 9, 150, 0.05, 4e-5, 0.3, 20000, 240, 16, 0.03, 6, -0.1, 2.6, 1.0,
     0, -0.35, 3.0, -0.01, -0.14, 0.03},
    {"ankle", 100, 0.06, 4e-5, 14000, 3, 60, 0.03, 2e-5, 0.15, 6000, 60, 11, 0.025, 7.5, -1.4, 1.0, -0.4,
     0, -0.33, 0.8, 0, -0.02, 0.001},
};

struct motion body;

/* Point of a body: on link `link`, at (x, z) of its axes. */
struct mass { int link; double x, z, mass, inertia; };
static const struct mass FOOT = {ANKLE, FOOT_X, SENSOR_Z + FOOT_Z, FOOT_MASS, FOOT_INERTIA};

/* (x, z) of axes turned by a, seen from outside. */
static void turn(double a, double x, double z, double out[2]) {
    out[0] = x * cos(a) + z * sin(a);
    out[1] = -x * sin(a) + z * cos(a);
}

/* Derivatives of the point's position by each link's angle, and its acceleration by their velocities alone. */
static void jacobian(const struct mass *m, const double angle[JOINTS], const double velocity[JOINTS],
                     double by[JOINTS][2], double centripetal[2]) {
    centripetal[0] = centripetal[1] = 0;
    for (int i = 0; i < JOINTS; i++) {
        double arm[2] = {0, 0};
        if (i < m->link)
            turn(angle[i], SHEET[i + 1].origin_x, SHEET[i + 1].origin_z, arm);
        else if (i == m->link)
            turn(angle[i], m->x, m->z, arm);
        by[i][0] = arm[1];
        by[i][1] = -arm[0];
        for (int k = 0; k < 2; k++) centripetal[k] -= arm[k] * velocity[i] * velocity[i];
    }
}

/* Angles of the links against the vertical from those of the joints. */
static void sums(const double joint[JOINTS], double link[JOINTS]) {
    double sum = 0;
    for (int i = 0; i < JOINTS; i++) link[i] = sum += joint[i];
}

static void add(const struct mass *m, const double angle[JOINTS], const double velocity[JOINTS],
                double M[JOINTS][JOINTS], double force[JOINTS]) {
    double by[JOINTS][2], centripetal[2];
    jacobian(m, angle, velocity, by, centripetal);
    for (int i = 0; i < JOINTS; i++) {
        for (int k = 0; k < JOINTS; k++) M[i][k] += m->mass * (by[i][0] * by[k][0] + by[i][1] * by[k][1]);
        force[i] -= m->mass * (by[i][0] * centripetal[0] + by[i][1] * (centripetal[1] + GRAVITY));
    }
    M[m->link][m->link] += m->inertia;
}

/* Gauss's elimination of a symmetric positive matrix. */
static void solve(double M[JOINTS][JOINTS], double x[JOINTS]) {
    for (int p = 0; p < JOINTS; p++)
        for (int r = p + 1; r < JOINTS; r++) {
            double f = M[r][p] / M[p][p];
            for (int c = p; c < JOINTS; c++) M[r][c] -= f * M[p][c];
            x[r] -= f * x[p];
        }
    for (int p = JOINTS - 1; p >= 0; p--) {
        for (int c = p + 1; c < JOINTS; c++) x[p] -= M[p][c] * x[c];
        x[p] /= M[p][p];
    }
}

static double end_stop(const struct sheet *s, double q, double dq) {
    if (q < s->stop_low) return 2e4 * (s->stop_low - q) - 200 * dq;
    if (q > s->stop_high) return 2e4 * (s->stop_high - q) - 200 * dq;
    return 0;
}

void body_step(const double torque[JOINTS], double h) {
    double M[JOINTS][JOINTS] = {{0}}, force[JOINTS] = {0}, angle[JOINTS], velocity[JOINTS];
    sums(body.q, angle);
    sums(body.dq, velocity);
    for (int i = 0; i < JOINTS; i++) {
        struct mass link = {i, SHEET[i].com_x, SHEET[i].com_z, SHEET[i].mass, SHEET[i].inertia};
        add(&link, angle, velocity, M, force);
    }
    add(&FOOT, angle, velocity, M, force);
    for (int i = 0; i < JOINTS; i++) {
        const struct sheet *s = &SHEET[i];
        double t = torque[i] + end_stop(s, body.q[i], body.dq[i]);
        t -= s->bearing * (tanh(body.dq[i] / 2e-3) + 0.5 * body.dq[i]);
        force[i] += t; /* a joint's torque turns its own link on and the one before it back */
        if (i > 0) force[i - 1] -= t;
    }
    solve(M, force);
    for (int i = 0; i < JOINTS; i++) {
        body.ddq[i] = force[i] - (i > 0 ? force[i - 1] : 0);
        body.dq[i] += h * body.ddq[i];
        body.q[i] += h * body.dq[i];
    }
}

void body_wrench(double wrench[3]) {
    double angle[JOINTS], velocity[JOINTS], acceleration[JOINTS], by[JOINTS][2], a[2];
    sums(body.q, angle);
    sums(body.dq, velocity);
    sums(body.ddq, acceleration);
    jacobian(&FOOT, angle, velocity, by, a);
    a[1] += GRAVITY;
    for (int i = 0; i < JOINTS; i++)
        for (int k = 0; k < 2; k++) a[k] += by[i][k] * acceleration[i];
    double f[2];
    turn(-angle[ANKLE], -FOOT_MASS * a[0], -FOOT_MASS * a[1], f);
    wrench[0] = f[0];
    wrench[1] = f[1];
    wrench[2] = FOOT_Z * f[0] - FOOT_X * f[1] - FOOT_INERTIA * acceleration[ANKLE];
}
