/* Drives by CiA 402, each with its motor, brake and gear. The position loop knows nothing but its own encoder. */
#include "robot.h"

#include <math.h>
#include <string.h>

#define TIME_OUT 0.04        /* longest silence of set-points while enabled, s; of the first one 0.2 s */
#define BRAKE_OPENS 0.02
#define BRAKE_SHUTS 0.01
#define BRISTLE 1e-4         /* way after which friction is full, rad */
#define BRAKE_FACTOR 2.0     /* what the brake bears, in torque limits */
#define WINDOW_TIME 0.002

struct drive drive[JOINTS];
struct joint_faults fault[JOINTS];
struct robot_faults robot_fault;
int drives_have_time_out = 1;

static int has_torque(const struct drive *d) {
    return d->powered && (d->state == ENABLED || d->state == QUICK_STOP);
}

static double clamp(double x, double limit) { return x > limit ? limit : x < -limit ? -limit : x; }

/* Spring that slides at a torque: friction at rest and in motion. */
static double bristle(double *way, double velocity, double full, double h) {
    *way = clamp(*way + velocity * h, BRISTLE);
    return full / BRISTLE * *way;
}

void drives_start(void) {
    for (int j = 0; j < JOINTS; j++) {
        body.q[j] = drive[j].phi = SHEET[j].start;
        drive[j].shown = drive[j].shown_before = drive[j].phi;
        drive[j].state = DISABLED;
        drive[j].powered = 1;
    }
}

static void enter(struct drive *d, enum state state, int error) {
    if (state == ENABLED) d->enabled_for = d->silence = d->away = 0;
    d->state = state;
    d->error = error;
}

void drives_sync(void) {
    for (int j = 0; j < JOINTS; j++) {
        struct drive *d = &drive[j];
        d->current_target = d->next_current;
        if (d->state != QUICK_STOP) d->target = d->next_target; /* where it stopped it stays */
    }
}

/* Switches a drive on: set-points of before hold only where it remembers them. */
static void take_over(int j) {
    struct drive *d = &drive[j];
    if (!fault[j].memory) d->target = d->next_target = d->shown;
    d->current_target = d->next_current = 0;
    enter(d, ENABLED, 0);
}

void drive_control(int j, int word) {
    struct drive *d = &drive[j];
    int reset = word & ~d->last_control & 0x80;
    d->last_control = word;
    if (!d->powered || fault[j].control_deaf) return;
    if (d->state == FAILED) {
        if (reset) enter(d, DISABLED, 0);
        return;
    }
    int quick_stop = !(word & 4) && (word & 2), voltage = word & 2;
    if (!voltage) enter(d, DISABLED, 0);
    else if (quick_stop) { if (d->state == ENABLED) enter(d, QUICK_STOP, 0); else if (d->state != QUICK_STOP) enter(d, DISABLED, 0); }
    else if ((word & 0xf) == 6) { if (d->state != QUICK_STOP) enter(d, READY, 0); }
    else if ((word & 0xf) == 7) { if (d->state == READY || d->state == ENABLED) enter(d, SWITCHED_ON, 0); }
    else if ((word & 0xf) == 0xf) {
        if (d->state == READY) enter(d, SWITCHED_ON, 0);
        else if (d->state == SWITCHED_ON) take_over(j);
    }
}

void drive_target(int j, double target) {
    if (!drive[j].powered) return;
    drive[j].next_target = target;
    drive[j].silence = 0;
    if (drive[j].enabled_for < 0.2) drive[j].enabled_for = 0.2;
}

void drive_current(int j, double current) {
    drive_target(j, drive[j].next_target);
    drive[j].next_current = current;
}

void drive_counts(int j, long counts) { drive_target(j, counts * 2 * M_PI / (MOTOR_COUNTS * SHEET[j].ratio)); }

void drive_quick_stop(int j) {
    if (drive[j].state == ENABLED) enter(&drive[j], QUICK_STOP, 0);
}

void drive_reset(int j) {
    enter(&drive[j], DISABLED, 0);
    drive[j].last_control = 0;
}

int drive_status(int j) {
    static const int WORD[] = {0x00, 0x40, 0x21, 0x23, 0x27, 0x07, 0x08};
    const struct drive *d = &drive[j];
    int supplied = d->state == DISABLED && d->error == 0 ? 0x10 : d->state == FAILED ? 0 : 0x10;
    return d->powered ? WORD[d->state] | supplied | 0x200 | (d->state == ENABLED ? 0x1000 : 0) : 0;
}

/* Its own encoder, as loop and frames see it. */
static void look(int j, double h) {
    struct drive *d = &drive[j];
    const struct joint_faults *f = &fault[j];
    d->motor_drift += f->motor_rate * h;
    double a = d->phi;
    if (f->motor_scale) a *= f->motor_scale;
    a += f->motor_offset + d->motor_drift + d->lost_zero;
    if (f->motor_negative) a = -a;
    if (f->motor_stuck) a = d->stuck_at; else d->stuck_at = a;
    d->shown_before = d->shown;
    d->shown = a;
    /* A slip is no velocity that a drive would believe. */
    double velocity = clamp((d->shown - d->shown_before) / h, 40);
    d->shown_velocity += (velocity - d->shown_velocity) * h / (5e-4 + h);
}

/* At the velocity at which the supply's voltage is used up a motor makes no more torque along its motion. */
static double by_voltage(int j, double current) {
    double limit = SHEET[j].current_limit, free = SHEET[j].free_velocity;
    double left = limit * fmax(0, fmin(1, 4 * (1 - fabs(drive[j].dphi) / free)));
    return current * drive[j].dphi > 0 ? clamp(current, left) : current;
}

static double loop(int j, double h) {
    struct drive *d = &drive[j];
    const struct joint_faults *f = &fault[j];
    const struct sheet *s = &SHEET[j];
    double limit = s->current_limit * (f->current_scale ? f->current_scale : 1);
    if (robot_fault.by_current) return clamp(d->current_target, limit);
    double target = f->target_zero ? 0 : d->target;
    if (f->target_mirrored) target = -target;
    d->target_drift += f->target_rate * h;
    target += f->target_shift + d->target_drift;
    double error = target - d->shown;
    d->away = f->window && fabs(error) > f->window ? d->away + h : 0;
    if (d->away > WINDOW_TIME && !f->control_deaf) enter(d, FAILED, 2);
    double torque = s->kp * error - s->kd * d->shown_velocity;
    if (f->loop_reversed) torque = -torque;
    return f->no_torque ? 0 : clamp(torque / (s->ratio * s->kt), limit);
}

/* Power, time-outs, brake. */
static void watch(int j, double h) {
    struct drive *d = &drive[j];
    struct joint_faults *f = &fault[j];
    if (f->restart_ms > 0) {
        d->dark = f->restart_ms * 1e-3;
        d->powered = 0;
        f->restart_ms = 0;
    }
    if (!d->powered && (d->dark -= h) <= 0) { /* it starts again: off, without set-point */
        d->powered = 1;
        enter(d, DISABLED, 0);
        d->last_control = 0;
        d->next_target = d->target = 0;
        if (f->restart_counter) d->lost_zero = -d->phi;
        d->lost_zero += f->restart_shift;
        f->restart_shift = 0;
    }
    d->silence += h;
    d->enabled_for += h;
    int heard = d->enabled_for >= 0.2;
    if (d->powered && d->state == ENABLED && heard && d->silence > TIME_OUT && drives_have_time_out && !f->no_time_out) enter(d, FAILED, 5);
    double way = has_torque(d) ? h / BRAKE_OPENS : -h / BRAKE_SHUTS;
    d->brake = fmax(0, fmin(1, d->brake + way));
}

static void rotor(int j, double h) {
    struct drive *d = &drive[j];
    const struct sheet *s = &SHEET[j];
    double x = d->phi - body.q[j], full = s->torque_limit / s->stiffness;
    d->gear_torque = s->stiffness * x * (1 + 0.2 * x * x / (full * full)) + s->damping * (d->dphi - body.dq[j]);
    double wanted = has_torque(d) ? by_voltage(j, loop(j, h)) : 0;
    d->current += (wanted - d->current) * h / (2e-4 + h);
    if (!has_torque(d)) d->current = 0;
    double kt = s->kt * s->ratio * (fault[j].kt_scale ? fault[j].kt_scale : 1);
    double torque = kt * d->current - d->gear_torque;
    torque -= bristle(&d->bristle, d->dphi, s->coulomb * s->ratio, h);
    torque -= (s->viscous * s->ratio * s->ratio + fault[j].viscous) * d->dphi;
    int shut = d->brake < 0.5 || fault[j].brake_stuck;
    if (shut) {
        torque -= bristle(&d->brake_bristle, d->dphi, BRAKE_FACTOR * s->torque_limit, h) + 2000 * d->dphi;
    } else {
        d->brake_bristle = 0;
        torque -= 20 * d->dphi * (1 - fabs(d->bristle) / BRISTLE); /* a bristle has damping */
    }
    d->dphi += h * torque / (s->rotor * s->ratio * s->ratio);
    d->phi += h * d->dphi;
}

void drives_step(double h) {
    double torque[JOINTS];
    if (robot_fault.supply_ms > 0) { /* one supply for all */
        for (int j = 0; j < JOINTS; j++) fault[j].restart_ms = robot_fault.supply_ms;
        robot_fault.supply_ms = 0;
    }
    for (int j = 0; j < JOINTS; j++) {
        watch(j, h);
        look(j, h);
        rotor(j, h);
        torque[j] = drive[j].gear_torque + fault[j].hand;
    }
    body_step(torque, h);
    for (int j = 0; j < JOINTS; j++)
        if (fabs(body.dq[j]) > fabs(drive[j].peak)) drive[j].peak = body.dq[j];
}
