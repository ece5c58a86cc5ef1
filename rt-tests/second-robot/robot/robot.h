/* A leg of three joints in a vertical plane, its drives, encoders and F/T sensor. SI units; angles of motors are
 * divided by the gear ratio, torques are on the link side, unless it says otherwise. */
#ifndef ROBOT_H
#define ROBOT_H

#include <stdint.h>

enum { HIP, KNEE, ANKLE, JOINTS };

#define LINK_COUNTS 1048576.0 /* a turn */
#define MOTOR_COUNTS 8192.0

/* Data sheet of one joint. */
struct sheet {
    const char *name;
    double ratio, kt, rotor;      /* gear ratio, Nm/A and kg m2 at the motor */
    double stiffness, damping;    /* of the gear: Nm/rad, Nms/rad */
    double torque_limit;          /* Nm: at it the gear is a fifth stiffer */
    double coulomb, viscous;      /* friction, motor side: Nm, Nms/rad */
    double bearing;               /* friction of the link's bearing, Nm */
    double kp, kd;                /* position loop of the drive: Nm/rad, Nms/rad */
    double current_limit, noise;  /* A; standard deviation of a measured current, A */
    double free_velocity;         /* of the motor without load, rad/s of the joint */
    double stop_low, stop_high;   /* end stops, rad */
    double start;                 /* angle at the start, rad */
    double origin_x, origin_z;    /* of the joint, in the link before it, m */
    double mass, com_x, com_z, inertia;
};
extern const struct sheet SHEET[JOINTS];

/* Faults, set by name. Of a joint: */
#define JOINT_FAULTS(X) \
    /* motor encoder, for the drive's loop and the frames alike: offset, rate, sign, scale, stuck */ \
    X(motor_offset) X(motor_rate) X(motor_negative) X(motor_scale) X(motor_stuck) \
    X(link_offset) X(link_rate) X(link_negative) X(link_stuck) \
    /* drive: set-point at zero, mirrored, shifted, old, drifting; loop reversed, without torque */ \
    X(target_zero) X(target_mirrored) X(target_shift) X(target_old) X(target_rate) X(loop_reversed) X(no_torque) \
    X(control_deaf) X(no_time_out) X(memory) X(window) X(current_scale) X(kt_scale) X(brake_stuck) \
    /* for so many ms: silent and without power; then its zero is lost by so much, or its counter begins at 0 */ \
    X(restart_ms) X(restart_shift) X(restart_counter) \
    /* frames: none, one with another status word, late by so much; current's sign; torque from a hand; further
     * viscous friction of the rotor, Nms/rad of the joint */ \
    X(mute) X(status_once) X(late_us) X(current_negative) X(hand) X(viscous)
/* Of the robot: */
#define ROBOT_FAULTS(X) \
    X(ft_fx) X(ft_fz) X(ft_ty) X(ft_fx_rate) X(ft_fy_rate) X(ft_fz_rate) X(ft_tx_rate) X(ft_ty_rate) X(ft_tz_rate) \
    X(supply_ms) X(sync_echo) X(foreign) X(plugs) X(by_current)

#define FIELD(n) n,
struct joint_faults { double JOINT_FAULTS(FIELD) end; };
struct robot_faults { double ROBOT_FAULTS(FIELD) end; };
#undef FIELD
extern struct joint_faults fault[JOINTS];
extern struct robot_faults robot_fault;

/* Bodies (body.c) */
struct motion { double q[JOINTS], dq[JOINTS], ddq[JOINTS]; };
extern struct motion body;
/* One step under these torques on the links. */
void body_step(const double torque[JOINTS], double h);
/* What the foot applies to the sensor, in the sensor's axes: fx, fz, ty. */
void body_wrench(double wrench[3]);

/* Drives (drive.c) */
enum state { NOT_READY, DISABLED, READY, SWITCHED_ON, ENABLED, QUICK_STOP, FAILED };
struct drive {
    enum state state;
    int powered, error, last_control;
    double phi, dphi;             /* true angle and velocity of the rotor */
    double bristle, brake_bristle;
    double current, gear_torque;  /* true current, torque of the gear on the link */
    double shown, shown_before, shown_velocity; /* by its own encoder */
    double lost_zero, stuck_at;
    double target, next_target;   /* set-point that acts, and the one received for the next SYNC */
    double current_target, next_current;
    double brake;                 /* 1 open, 0 shut */
    double silence, away, dark, enabled_for, peak; /* s; peak: fastest velocity of the link in this period */
    double motor_drift, target_drift;
};
extern struct drive drive[JOINTS];
void drives_start(void);
void drives_sync(void);           /* set-points received before a SYNC act from it on */
void drives_step(double h);       /* one step of everything that is not a frame */
void drive_control(int j, int word);
void drive_target(int j, double target);
void drive_current(int j, double current);
int drive_status(int j);
void drive_quick_stop(int j);
void drive_reset(int j);          /* off, whatever it hears */
void drive_counts(int j, long counts); /* set-point in counts of the motor encoder */
extern int drives_have_time_out;  /* for set-points */

/* Frames (bus.c). Answers to a SYNC leave as datagrams of python-can. */
enum { BUSES = 2 };
void bus_open(void);
int bus_socket(int bus);
void bus_send(int bus, int id, const uint8_t *data, int length);
/* Parses a datagram; its identifier or -1, its data and their length. */
int bus_parse(const uint8_t *datagram, int length, const uint8_t **data, int *data_length);

/* What encoders, current sensor and drive of a joint show, faults included (main.c). */
struct reading { long link, motor; double current; int status; };
struct reading read_joint(int j);
/* A frame of one drive leaves, if it has power and is not mute. */
void node_send(int j, int id, const uint8_t *data, int length);

/* Nodes of CANopen in place of the frames of bus 0 (canopen.c) */
void canopen_start(void);
void canopen_frame(int id, const uint8_t *data, int length);
void canopen_sync(void);
void canopen_advance(double h);

double gauss(void);
#endif
