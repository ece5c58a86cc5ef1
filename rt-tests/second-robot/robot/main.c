/* The robot in real time: SYNC advances it by one period, and it answers. Without SYNC time goes on.
 *
 *   robot RATE_HZ LOG [canopen]    its drives share one frame, or are nodes of CANopen.
 *
 * Faults come on standard input, one a line: NAME JOINT VALUE; JOINT "all" of all joints, "-" of the robot. "mark - N"
 * is shown in the log from the next period on, "clear - 0" ends all faults, "mend - 0" restores lost zeros, "flush - 0"
 * writes the log and answers "flushed".
 *
 * LOG: of each period float64 values: stamp of the newest SYNC (monotonic, s), time from it until the answers were sent,
 * mark; then per joint q, fastest dq, motor angle, torque of the gear, set-point, state, current. */
#define _GNU_SOURCE
#include "robot.h"

#include <math.h>
#include <poll.h>
#include <sched.h>
#include <signal.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#define STEP 1e-4
enum {
    ID_SYNC = 0x80,
    ID_CONTROL = 0x210,
    ID_POSITIONS = 0x220,
    ID_CURRENTS = 0x230,
    ID_STATE = 0x300, /* and the joint's number */
    ID_WRENCH = 0x380,
};

static double period, last, last_stamp, answered_after, mark;
static double link_drift[JOINTS], link_stuck_at[JOINTS], ft_drift[6];
static FILE *log_file;
static volatile sig_atomic_t over;
/* Answers that are held back. */
static struct late { double due; int id, length; uint8_t data[12]; } late[256];
static int late_count, echoes[BUSES], by_canopen;

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec + t.tv_nsec * 1e-9;
}

static double uniform(void) { return (random() + 0.5) / (RAND_MAX + 1.0); }
double gauss(void) { return sqrt(-2 * log(uniform())) * cos(2 * M_PI * uniform()); }

static uint8_t *put(uint8_t *p, long value, int bytes) {
    for (; bytes > 0; bytes--, value >>= 8) *p++ = value & 0xff;
    return p;
}

static long take(const uint8_t *p, int bytes) {
    long v = 0;
    for (int i = 0; i < bytes; i++) v |= (long)p[i] << 8 * i;
    return bytes == 4 ? (int32_t)v : v;
}

static void record(double stamp) {
    double row[3 + 7 * JOINTS] = {stamp, answered_after, mark};
    for (int j = 0; j < JOINTS; j++) {
        struct drive *d = &drive[j];
        double *r = row + 3 + 7 * j;
        r[0] = body.q[j];
        r[1] = d->peak;
        r[2] = d->phi;
        r[3] = d->gear_torque;
        r[4] = d->target;
        r[5] = d->powered ? (int)d->state : -1;
        r[6] = d->current;
        d->peak = 0;
    }
    fwrite(row, sizeof row, 1, log_file);
}

static void advance(double stamp) {
    drives_sync();
    for (int n = lround(period / STEP); n > 0; n--) drives_step(STEP);
    for (int j = 0; j < JOINTS; j++) link_drift[j] += fault[j].link_rate * period;
    const double *rate = &robot_fault.ft_fx_rate;
    for (int i = 0; i < 6; i++) ft_drift[i] += rate[i] * period;
    if (by_canopen) canopen_advance(period);
    if (stamp > 0) record(stamp);
}

/* Which joint answers as joint j: the plugs of hip and ankle may be exchanged. */
static int plugged(int j) { return robot_fault.plugs && j != KNEE ? HIP + ANKLE - j : j; }

struct reading read_joint(int j) {
    struct drive *d = &drive[j];
    struct joint_faults *f = &fault[j];
    double q = body.q[j] + f->link_offset + link_drift[j];
    if (f->link_negative) q = -q;
    if (f->link_stuck) q = link_stuck_at[j]; else link_stuck_at[j] = q;
    struct reading r = {
        .link = lround(q / (2 * M_PI) * LINK_COUNTS + 0.7 * gauss()),
        .motor = lround(d->shown * SHEET[j].ratio / (2 * M_PI) * MOTOR_COUNTS + 0.3 * gauss()),
        .current = (f->current_negative ? -1 : 1) * d->current + SHEET[j].noise * gauss(),
        .status = f->status_once ? (int)f->status_once : drive_status(j),
    };
    f->status_once = 0;
    return r;
}

void node_send(int j, int id, const uint8_t *data, int length) {
    struct joint_faults *f = &fault[j];
    if (f->mute || !drive[j].powered) return;
    if (f->late_us > 0 && late_count < 256) {
        struct late *l = &late[late_count++];
        *l = (struct late){.due = now() + f->late_us * uniform() * 1e-6, .id = id, .length = length};
        memcpy(l->data, data, length);
    } else {
        bus_send(0, id, data, length);
    }
}

static void answer_joint(int j) {
    struct reading r = read_joint(j);
    uint8_t data[12], *p = data;
    p = put(p, r.link, 4);
    p = put(p, r.motor, 4);
    p = put(p, lround(r.current * 1000), 2);
    put(p, r.status, 2);
    node_send(j, ID_STATE + plugged(j), data, sizeof data);
}

static void answer_wrench(void) {
    double w[3], out[6] = {0};
    body_wrench(w);
    out[0] = w[0] + robot_fault.ft_fx;
    out[2] = w[1] + robot_fault.ft_fz;
    out[4] = w[2] + robot_fault.ft_ty;
    uint8_t data[24], *p = data;
    for (int i = 0; i < 6; i++) {
        double sigma = i < 3 ? 0.25 : 0.015, resolution = i < 3 ? 0.02 : 0.001;
        p = put(p, lround((out[i] + ft_drift[i] + sigma * gauss()) / resolution), 4);
    }
    bus_send(1, ID_WRENCH, data, sizeof data);
}

/* The drives' clock follows SYNC; one that comes twice is answered twice, but time does not advance by it. */
static void on_sync(int bus, double stamp) {
    if (bus == 0) {
        long periods = last ? lround((stamp - last) / period) : 1;
        if (periods > 50) periods = 50;
        last_stamp = stamp;
        for (long i = 0; i < periods; i++) advance(stamp);
        if (periods > 0) last = last ? last + periods * period + 0.2 * (stamp - last - periods * period) : stamp;
        if (by_canopen) canopen_sync();
        else for (int j = 0; j < JOINTS; j++) answer_joint(j);
        for (int i = 0; i < (int)robot_fault.foreign; i++) bus_send(0, 0x700 + i % 64, (uint8_t[4]){0}, 4);
    } else {
        answer_wrench();
    }
    if (robot_fault.sync_echo) {
        echoes[bus]++;
        bus_send(bus, ID_SYNC, (uint8_t[1]){0}, 0);
    }
    if (bus == 0) answered_after = now() - stamp;
}

static void on_frame(int bus, const uint8_t *datagram, int length, double stamp) {
    const uint8_t *data;
    int n, id = bus_parse(datagram, length, &data, &n);
    if (id == ID_SYNC && echoes[bus] > 0) echoes[bus]--; /* its own, which comes back */
    else if (id == ID_SYNC) on_sync(bus, stamp);
    if (bus != 0) return;
    if (by_canopen) {
        canopen_frame(id, data, n);
        return;
    }
    for (int k = 0; k < JOINTS; k++) {
        int j = plugged(k);
        if (id == ID_CONTROL && n == 2 * JOINTS) drive_control(j, take(data + 2 * k, 2));
        if (id == ID_POSITIONS && n == 4 * JOINTS) drive_target(j, take(data + 4 * k, 4) * 1e-6);
        if (id == ID_CURRENTS && n == 4 * JOINTS) drive_current(j, take(data + 4 * k, 4) * 1e-3);
    }
}

static const char *const JOINT_FAULT_NAMES[] = {
#define NAME(n) #n,
    JOINT_FAULTS(NAME)
};
static const char *const ROBOT_FAULT_NAMES[] = {ROBOT_FAULTS(NAME)};
#define COUNT(names) (sizeof names / sizeof names[0])

static void clear(void) {
    double by_current = robot_fault.by_current, plugs = robot_fault.plugs;
    memset(fault, 0, sizeof fault);
    memset(&robot_fault, 0, sizeof robot_fault);
    robot_fault.by_current = by_current;
    robot_fault.plugs = plugs;
    memset(link_drift, 0, sizeof link_drift);
    memset(ft_drift, 0, sizeof ft_drift);
    for (int j = 0; j < JOINTS; j++) drive[j].motor_drift = drive[j].target_drift = 0;
}

static int set_fault(const char *name, const char *joint, double value) {
    int known = 0;
    for (size_t i = 0; i < COUNT(JOINT_FAULT_NAMES); i++)
        for (int j = 0; j < JOINTS; j++)
            if (!strcmp(name, JOINT_FAULT_NAMES[i]) && (!strcmp(joint, "all") || !strcmp(joint, SHEET[j].name))) {
                ((double *)&fault[j])[i] = value;
                known = 1;
            }
    for (size_t i = 0; i < COUNT(ROBOT_FAULT_NAMES); i++)
        if (!strcmp(name, ROBOT_FAULT_NAMES[i])) {
            ((double *)&robot_fault)[i] = value;
            known = 1;
        }
    return known;
}

static void command(const char *line) {
    char name[32], joint[16];
    double value;
    if (sscanf(line, "%31s %15s %lf", name, joint, &value) != 3) exit(2);
    if (!strcmp(name, "mark")) mark = value;
    else if (!strcmp(name, "clear")) clear();
    else if (!strcmp(name, "mend")) for (int j = 0; j < JOINTS; j++) drive[j].lost_zero = 0;
    else if (!strcmp(name, "flush")) { fflush(log_file); puts("flushed"); fflush(stdout); }
    else if (!set_fault(name, joint, value)) { fprintf(stderr, "unknown: %s\n", line); exit(2); }
}

static void read_commands(void) {
    static char text[65536];
    static size_t held;
    ssize_t n = read(0, text + held, sizeof text - held - 1);
    if (n <= 0) { over = 1; return; }
    held += n;
    text[held] = 0;
    char *begin = text, *end;
    while ((end = strchr(begin, '\n'))) {
        *end = 0;
        command(begin);
        begin = end + 1;
    }
    held = strlen(begin);
    memmove(text, begin, held + 1);
}

/* Receives what has come; a frame's time is the kernel's, on the monotonic clock. */
static void receive(int bus) {
    for (int i = 0; i < 64; i++) {
        uint8_t datagram[2048], control[128];
        struct iovec part = {datagram, sizeof datagram};
        struct msghdr m = {.msg_iov = &part, .msg_iovlen = 1, .msg_control = control, .msg_controllen = sizeof control};
        ssize_t n = recvmsg(bus_socket(bus), &m, 0);
        if (n <= 0) return;
        double stamp = now();
        for (struct cmsghdr *c = CMSG_FIRSTHDR(&m); c; c = CMSG_NXTHDR(&m, c)) {
            if (c->cmsg_type != SO_TIMESTAMPNS) continue;
            struct timespec received, wall;
            memcpy(&received, CMSG_DATA(c), sizeof received);
            clock_gettime(CLOCK_REALTIME, &wall);
            double age = wall.tv_sec - received.tv_sec + (wall.tv_nsec - received.tv_nsec) * 1e-9;
            if (age > 0 && age < 0.5) stamp -= age;
        }
        on_frame(bus, datagram, n, stamp);
    }
}

static void send_late(void) {
    double t = now();
    for (int i = 0; i < late_count;) {
        if (late[i].due > t) { i++; continue; }
        bus_send(0, late[i].id, late[i].data, late[i].length);
        late[i] = late[--late_count];
    }
}

static void end(int number) { (void)number; over = 1; }

int main(int count, char **arguments) {
    by_canopen = count == 4 && !strcmp(arguments[3], "canopen");
    if (count != 3 && !by_canopen) return 2;
    period = 1 / atof(arguments[1]);
    log_file = fopen(arguments[2], "wb");
    if (!log_file) { perror(arguments[2]); return 1; }
    setvbuf(log_file, 0, _IOFBF, 1 << 20);
    signal(SIGTERM, end);
    bus_open();
    drives_start();
    for (int i = 0; i < 5000; i++) drives_step(STEP); /* the gears bear the weight, brakes are shut */
    drives_have_time_out = !by_canopen;
    if (by_canopen) canopen_start();
    if (by_canopen) last = now(); /* nodes are set up before the first SYNC */
    mlockall(MCL_CURRENT);
    struct sched_param priority = {.sched_priority = 70};
    sched_setscheduler(0, SCHED_FIFO, &priority); /* where it may */
    puts("ready");
    fflush(stdout);
    while (!over) {
        struct pollfd polled[] = {{bus_socket(0), POLLIN, 0}, {bus_socket(1), POLLIN, 0}, {0, POLLIN, 0}};
        struct timespec wait = {0, late_count ? 50000 : (long)(period * 1e9)};
        ppoll(polled, 3, &wait, 0);
        if (polled[2].revents) read_commands();
        for (int b = 0; b < BUSES; b++)
            if (polled[b].revents & POLLIN) receive(b);
        send_late();
        while (last && now() - last > 3 * period) { /* no SYNC: time goes on */
            advance(last_stamp);
            last += period;
        }
    }
    fclose(log_file);
    return 0;
}
