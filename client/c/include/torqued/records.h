/* The records in shared memory: SI units, config order. Generated, do not edit:
 *
 *     cargo run -p torqued-client --example generate_c_layout > client/c/include/torqued/records.h
 *
 * Texts are UTF-8, padded with zero bytes; one that fills its array has no zero at its end. */

#ifndef TORQUED_RECORDS_H
#define TORQUED_RECORDS_H

#include <stdint.h>

#ifdef __cplusplus
#define TORQUED_SIZE(type, size) static_assert(sizeof(type) == (size), #type)
#else
#define TORQUED_SIZE(type, size) _Static_assert(sizeof(type) == (size), #type)
#endif

#define TORQUED_MAX_JOINTS 64
#define TORQUED_MAX_FT_SENSORS 8
#define TORQUED_MAX_FURTHER_IMUS 3
#define TORQUED_MAX_POINTS 32
#define TORQUED_MAX_FRAMES 4
#define TORQUED_MAX_CONTACT_SETS 16
#define TORQUED_EVENT_COUNT 64

/** Mode of the robot. */
enum TorquedMode {
  TORQUED_MODE_HOLD = 0,
  TORQUED_MODE_TORQUE = 1,
  TORQUED_MODE_INVERSE_DYNAMICS = 2,
  TORQUED_MODE_POSITION = 3,
  TORQUED_MODE_CARTESIAN = 4,
  TORQUED_MODE_PASSIVE = 5,
  TORQUED_MODE_TORQUE_FEEDBACK_MOTION = 6,
  TORQUED_MODE_LOW_GAIN_TRACKING = 7,
  TORQUED_MODE_VELOCITY = 8,
  TORQUED_MODE_STAND = 9,
};

/** Kind of a joint: of a prismatic one m stands for rad and N for N·m on the link side. */
enum TorquedJointKind {
  TORQUED_JOINT_KIND_REVOLUTE = 0,
  TORQUED_JOINT_KIND_PRISMATIC = 1,
};

/** Source of a torque estimate. */
enum TorquedTorqueSource {
  TORQUED_TORQUE_SOURCE_NONE = 0,
  TORQUED_TORQUE_SOURCE_ENCODER = 1,
  TORQUED_TORQUE_SOURCE_WHOLE_BODY = 2,
  TORQUED_TORQUE_SOURCE_CURRENT = 3,
  TORQUED_TORQUE_SOURCE_FUSED = 4,
};

/** Flag bits of measured values. */
enum TorquedMeasuredFlags {
  TORQUED_MEASURED_FLAGS_MISSED = 1,
  TORQUED_MEASURED_FLAGS_STALE = 2,
  TORQUED_MEASURED_FLAGS_JUMP = 4,
  TORQUED_MEASURED_FLAGS_NEVER = 8,
  TORQUED_MEASURED_FLAGS_SETTLING = 16,
  TORQUED_MEASURED_FLAGS_IMPLAUSIBLE = 32,
  TORQUED_MEASURED_FLAGS_FLAT = 64,
  TORQUED_MEASURED_FLAGS_SATURATED = 128,
  TORQUED_MEASURED_FLAGS_STANDS_IN = 256,
};

/** Flag bits of a torque estimate. */
enum TorquedTorqueFlags {
  TORQUED_TORQUE_FLAGS_VALID = 1,
  TORQUED_TORQUE_FLAGS_SATURATED = 2,
  TORQUED_TORQUE_FLAGS_DEGRADED = 4,
};

/** State of the robot. */
enum TorquedRobotState {
  TORQUED_ROBOT_STATE_BOOT = 0,
  TORQUED_ROBOT_STATE_READY = 1,
  TORQUED_ROBOT_STATE_ENABLING = 2,
  TORQUED_ROBOT_STATE_HOLDING = 3,
  TORQUED_ROBOT_STATE_ACTIVE = 4,
  TORQUED_ROBOT_STATE_STOPPING = 5,
  TORQUED_ROBOT_STATE_FAULT = 6,
};

/** Flag bits of a joint's command. */
enum TorquedCommandFlags {
  TORQUED_COMMAND_FLAGS_POSITION_LIMITED = 1,
  TORQUED_COMMAND_FLAGS_TORQUE_LIMITED = 2,
  TORQUED_COMMAND_FLAGS_LEAD_LIMITED = 4,
  TORQUED_COMMAND_FLAGS_VELOCITY_LIMITED = 8,
  TORQUED_COMMAND_FLAGS_TORQUE_RATE_LIMITED = 16,
  TORQUED_COMMAND_FLAGS_POWER_LIMITED = 32,
  TORQUED_COMMAND_FLAGS_NOT_FINITE = 64,
  TORQUED_COMMAND_FLAGS_ENGAGED = 128,
  TORQUED_COMMAND_FLAGS_RATE_TRIMMED = 256,
};

/** Kind of a request. */
enum TorquedRequestKind {
  TORQUED_REQUEST_KIND_TARE = 1,
  TORQUED_REQUEST_KIND_SHOW_TARE = 2,
  TORQUED_REQUEST_KIND_FORGET_TARE = 3,
  TORQUED_REQUEST_KIND_CHOOSE_CONTACT_SET = 4,
  TORQUED_REQUEST_KIND_AUTOMATIC_CONTACT_SET = 5,
  TORQUED_REQUEST_KIND_ENABLE = 6,
  TORQUED_REQUEST_KIND_DISABLE = 7,
  TORQUED_REQUEST_KIND_STOP = 8,
  TORQUED_REQUEST_KIND_ACKNOWLEDGE = 9,
};

/** Progress of a request. */
enum TorquedAnswerStatus {
  TORQUED_ANSWER_STATUS_WORKING = 1,
  TORQUED_ANSWER_STATUS_DONE = 2,
  TORQUED_ANSWER_STATUS_REFUSED = 3,
};

/** Reason for which a reference was refused. */
enum TorquedLeaseRefusal {
  TORQUED_LEASE_REFUSAL_HELD = 1,
  TORQUED_LEASE_REFUSAL_HOLD_FIRST = 2,
  TORQUED_LEASE_REFUSAL_OLD_SESSION = 3,
  TORQUED_LEASE_REFUSAL_NOT_ADVANCED = 4,
  TORQUED_LEASE_REFUSAL_TOO_OLD = 5,
  TORQUED_LEASE_REFUSAL_INVALID = 6,
};

/** Flag bits of a frame in mode Cartesian. */
enum TorquedFrameFlags {
  TORQUED_FRAME_FLAGS_VALID = 1,
  TORQUED_FRAME_FLAGS_ACTIVE = 2,
  TORQUED_FRAME_FLAGS_WRENCH_LIMITED = 4,
  TORQUED_FRAME_FLAGS_GAINS_LIMITED = 8,
  TORQUED_FRAME_FLAGS_FORCE_KNOWN = 16,
  TORQUED_FRAME_FLAGS_LED = 32,
};

/** Reason for which no mode of the commander is followed. */
enum TorquedNotFollowed {
  TORQUED_NOT_FOLLOWED_FAULT = 1,
  TORQUED_NOT_FOLLOWED_STATE = 2,
  TORQUED_NOT_FOLLOWED_HOLD_FIRST = 3,
  TORQUED_NOT_FOLLOWED_NOT_READY = 4,
  TORQUED_NOT_FOLLOWED_NOT_POSSIBLE = 5,
};

/** Reason for which a piece of a trajectory was refused. */
enum TorquedPieceRefusal {
  TORQUED_PIECE_REFUSAL_SESSION = 1,
  TORQUED_PIECE_REFUSAL_INVALID = 2,
  TORQUED_PIECE_REFUSAL_LIMIT = 3,
  TORQUED_PIECE_REFUSAL_NOT_ADVANCED = 4,
  TORQUED_PIECE_REFUSAL_LATE = 5,
  TORQUED_PIECE_REFUSAL_GAP = 6,
  TORQUED_PIECE_REFUSAL_APART = 7,
  TORQUED_PIECE_REFUSAL_TOO_FAR = 8,
  TORQUED_PIECE_REFUSAL_BUSY = 9,
};

typedef struct TorquedCommanderRecord {
  /** Session that has the lease, or 0. */
  uint64_t session;
  /** Instant at which it got the lease, ns on the machine's `CLOCK_MONOTONIC`. */
  uint64_t since_ns;
  /** Sequence of its newest reference that the cycle has seen. */
  uint64_t sequence;
  /** Session that was refused last, or 0. */
  uint64_t refused_session;
  /** Time until the robot is at the target of mode position, s; 0 in other modes. */
  double motion_left_s;
  /** Trajectory that is buffered or followed, or 0. */
  uint64_t trajectory;
  /** Sequence of its session's newest piece that was judged, or 0. */
  uint64_t piece;
  /** Sequence of the piece that was refused last, or 0. */
  uint64_t refused_piece;
  /** Time since the trajectory began, s; 0 before. */
  double trajectory_s;
  /** Time until its last buffered point, s; 0 at rest there. */
  double trajectory_left_s;
  /** Why session `refused_session` was refused: one of `lease_refusal`. */
  uint32_t refused_reason;
  /** References refused since start. */
  uint32_t refused;
  /** How often a session of higher priority has taken the lease over since start. */
  uint32_t replaced;
  /** Priority of the session that has the lease. */
  uint32_t priority;
  /** Its process. */
  uint32_t pid;
  /** Why no mode is followed, one of `not_followed`, or 0. */
  uint32_t not_followed;
  /** Number of the event that has caused it, or 0, e.g. for an operator's request. */
  uint32_t cause;
  /** Why the piece `refused_piece` was refused: one of `piece_refusal`. */
  uint32_t piece_refusal;
  /** Pieces of trajectories refused since start. */
  uint32_t pieces_refused;
  /** Trajectories that ended in motion since start: no further piece had come. */
  uint32_t trajectories_ended;
} TorquedCommanderRecord;
TORQUED_SIZE(TorquedCommanderRecord, 120);

typedef struct TorquedJointMeasured {
  /** q: joint angle, rad, newest sample; without a link-side encoder theta/N less `torsion`. */
  double q;
  /** theta: motor-side angle, rad, unwrapped over many turns, newest sample. */
  double theta;
  /** torsion: theta/N - q, rad; positive when the motor drives the joint. Without a link-side encoder it is the one that the torque from F/T sensors and IMU explains. */
  double torsion;
  /** i: motor current, A, newest sample. */
  double current;
  /** dq: joint velocity, rad/s, from a short filter; used by control. */
  double dq;
  /** q_hat: filtered joint angle, rad, delayed by `filter_delay_s`. */
  double q_hat;
  /** dq_hat: filtered joint velocity, rad/s, delayed by `filter_delay_s`. */
  double dq_hat;
  /** ddq_hat: filtered joint acceleration, rad/s², delayed by `filter_delay_s`. */
  double ddq_hat;
  /** omega: motor-side velocity, rad/s: the drive's own, or from a short filter. */
  double omega;
  /** Temperature that the drive reports, of its winding where it reports more than one, °C; as long as `reported` has its bit, as the next three. */
  double temperature;
  /** Voltage of the drive's supply, V. */
  double voltage;
  /** The drive's own torque, N·m at the joint. */
  double tau_drive;
  /** Age of the newest sample, s. */
  double age_s;
  /** Status word of the drive, as received. */
  uint32_t status;
  /** Number of the drive's error; 0: none. */
  uint32_t drive_error;
  /** Bits of `reported_flags`. */
  uint32_t reported;
  /** Bits of `measured_flags`. */
  uint32_t flags;
} TorquedJointMeasured;
TORQUED_SIZE(TorquedJointMeasured, 120);

typedef struct TorquedWrench {
  /** f: force, N, x y z. */
  double force[3];
  /** n: torque about the frame's origin, N·m, x y z. */
  double torque[3];
} TorquedWrench;
TORQUED_SIZE(TorquedWrench, 48);

typedef struct TorquedFtMeasured {
  /** Wrench that the part beyond the sensor applies to the part before it, newest sample, calibrated, `offset` subtracted. */
  TorquedWrench wrench;
  /** The same, filtered, delayed by `filter_delay_s`. */
  TorquedWrench wrench_hat;
  /** Offset that is subtracted from the calibrated reading: configuration and tare. */
  TorquedWrench offset;
  /** Temperature, °C; zero if the sensor does not measure it. */
  double temperature;
  /** Age of the newest sample, s. */
  double age_s;
  /** Bits of `measured_flags`. */
  uint32_t flags;
  /** Fills the record to a multiple of eight bytes. */
  uint32_t reserved;
} TorquedFtMeasured;
TORQUED_SIZE(TorquedFtMeasured, 168);

typedef struct TorquedImuMeasured {
  /** Angular velocity, rad/s, newest sample. */
  double gyro[3];
  /** Acceleration minus gravity, m/s², newest sample. */
  double accelerometer[3];
  /** Filtered angular velocity, rad/s, delayed by `filter_delay_s`. */
  double gyro_hat[3];
  /** Filtered acceleration minus gravity, m/s², delayed by `filter_delay_s`. */
  double accelerometer_hat[3];
  /** Angular acceleration from the filtered gyro, rad/s²; zero if it is neglected. */
  double angular_acceleration_hat[3];
  /** Age of the newest sample, s. */
  double age_s;
  /** Bits of `measured_flags`. */
  uint32_t flags;
  /** Fills the record to a multiple of eight bytes. */
  uint32_t reserved;
} TorquedImuMeasured;
TORQUED_SIZE(TorquedImuMeasured, 136);

typedef struct TorquedMeasuredRecord {
  /** Delay of the filtered quantities, s. */
  double filter_delay_s;
  /** The joints, in config order. */
  TorquedJointMeasured joints[64];
  /** The F/T sensors, in config order. */
  TorquedFtMeasured ft[8];
  /** The first IMU, which shows the base's motion, or what stands in for it; zero if there is none. */
  TorquedImuMeasured imu;
  /** The other IMUs, in config order. */
  TorquedImuMeasured further_imus[3];
} TorquedMeasuredRecord;
TORQUED_SIZE(TorquedMeasuredRecord, 9576);

typedef struct TorquedTorqueEstimate {
  /** tau: torque that the transmission applies to the child link along +q, N·m. */
  double tau;
  /** sigma: standard deviation of tau, N·m. */
  double sigma;
  /** Delay of the estimate against the newest sample, s. */
  double delay_s;
  /** One of `torque_source`. */
  uint32_t source;
  /** Bits of `torque_flags`. */
  uint32_t flags;
} TorquedTorqueEstimate;
TORQUED_SIZE(TorquedTorqueEstimate, 32);

typedef struct TorquedJointEstimated {
  /** Torque from encoders and current (Z): without delay, but with slow errors of the deformation model. No source and never valid without a link-side encoder. */
  TorquedTorqueEstimate tau_encoder;
  /** Torque from F/T sensors and IMU (D 2): independent of the joint's gear and motor, but delayed by the filters. */
  TorquedTorqueEstimate tau_whole_body;
  /** Torque from the motor current less friction (D3), a third opinion for the cross-check; not valid without `[cross_check]`, but for joints without a link-side encoder. */
  TorquedTorqueEstimate tau_current;
  /** tau_hat: delay-compensated torque: the present torque, from the changes of `tau_encoder` (without a link-side encoder `tau_current`) and the level of F/T sensors and rigid-body model. */
  TorquedTorqueEstimate tau_hat;
  /** tau_ext: torque of the environment on the joint apart from the contact wrenches that the F/T sensors determine, N·m, by a momentum observer; zero without `[external_torque]`. */
  double tau_ext;
  /** Change of that torque within the last half second, N·m: much later known by `tau_ext`, here some 6 ms old. */
  double tau_ext_change;
  /** The greater of |tau_ext| and |tau_ext_change|, each over its lower threshold, 1: 1 sets `contact_flag`, `external_torque.upper_ratio` raises event 209. */
  double contact_ratio;
  /** Heat of the motor's winding by its current, as a share of what the continuous current makes in the end (I²t); zero without `[drive.NAME.thermal]`. */
  double thermal_load;
  /** 1: contact detected. */
  uint32_t contact_flag;
  /** Fills the record to a multiple of eight bytes. */
  uint32_t reserved;
} TorquedJointEstimated;
TORQUED_SIZE(TorquedJointEstimated, 168);

typedef struct TorquedFtEstimated {
  /** f_hat: wrench that the environment applies to the end-effector, at the sensor's frame, inertia and weight of the end-effector removed (D 2.2). */
  TorquedWrench contact_wrench;
  /** Residual of the part beyond the sensor: the wrench that its contacts cannot explain, in the frame of the sensor's first link. */
  TorquedWrench residual;
  /** Expected standard deviation of `residual`; zero where the contacts explain any wrench. */
  TorquedWrench residual_sigma;
} TorquedFtEstimated;
TORQUED_SIZE(TorquedFtEstimated, 144);

typedef struct TorquedEstimatedRecord {
  /** The joints, in config order. */
  TorquedJointEstimated joints[64];
  /** The F/T sensors, in config order. */
  TorquedFtEstimated ft[8];
  /** f_u: wrench that no F/T sensor measures: that of the last contact of the contact set, by default at the unknown-wrench link (D 2.4). */
  TorquedWrench unknown_wrench;
  /** Expected standard deviation of `unknown_wrench`. */
  TorquedWrench unknown_wrench_sigma;
  /** Residual of the part with the root: the wrench that its contacts cannot explain, in the root's frame. */
  TorquedWrench residual;
  /** Expected standard deviation of `residual`; zero where the contacts explain any wrench. */
  TorquedWrench residual_sigma;
  /** Force of the environment at `external_torque.frame` that explains `tau_ext` best, in the root's axes, N; zero without a frame or while it does not follow from the torques. */
  double contact_force[3];
  /** Standard deviation of `contact_force`, N; zero where that is. */
  double contact_force_sigma[3];
  /** The contact set in use, an index of `Description::contact_set_names`. */
  uint32_t contact_set;
  /** 1: the automatic rule chooses the contact set; 0: a client or the configuration does. */
  uint32_t contact_set_automatic;
  /** Number of the first active event of the cross-check (204 to 208), or else of a hot drive (415), or 0. */
  uint32_t warning;
  /** The joint that `warning` is about, or the F/T sensor (events 205 and 208). */
  uint32_t warning_subject;
} TorquedEstimatedRecord;
TORQUED_SIZE(TorquedEstimatedRecord, 12160);

typedef struct TorquedJointCommanded {
  /** tau_d: desired torque, N·m (D12). */
  double tau_d;
  /** tau*: desired torque plus feedback on the estimated torque, N·m (D11). */
  double tau_star;
  /** delta_q: commanded offset to the measured position, rad (D10). */
  double delta_q;
  /** The command before all limits, rad or A; `flags` names the limits that changed it. */
  double asked;
  /** q_c: commanded position after all limits, rad (position-commanded drives). */
  double q_c;
  /** i_c: commanded current after all limits, A (current-commanded drives). */
  double current_c;
  /** Contribution to the command of the torque feed-forward, rad or A (D 5.5). */
  double feedforward_torque;
  /** Contribution to the command of the friction feed-forward, rad or A. */
  double feedforward_friction;
  /** Contribution to the command of the position error, rad or A. */
  double feedback_position;
  /** Contribution to the command of the velocity error, rad or A. */
  double feedback_velocity;
  /** Contribution to the command of the acceleration error, rad or A. */
  double feedback_acceleration;
  /** Contribution to the command of the contact force error, rad or A. */
  double feedback_force;
  /** Distance of the set-point that torque, velocity and position of the drive show from those sent last, rad or A; zero while no set-points are sent. */
  double following_error;
  /** Delay from the sample that a command is computed from to its effect in the motor's current, s, as measured while a client is followed; 0 until it is known. */
  double command_delay_s;
  /** Standard deviation of `command_delay_s`, s. */
  double command_delay_sigma_s;
  /** Torque that the command may ask for at present, N·m: the joint's limit, less while its drive is hot; zero while no set-points are sent. */
  double torque_limit;
  /** Bits of `command_flags`. */
  uint32_t flags;
  /** Number of the drive's `DriveState`; a drive without states counts as enabled. */
  uint32_t drive_state;
} TorquedJointCommanded;
TORQUED_SIZE(TorquedJointCommanded, 136);

typedef struct TorquedFrameCommanded {
  /** x: position of the frame's origin in its base, m. */
  double position[3];
  /** R: orientation of the frame in its base, a unit quaternion w x y z. */
  double orientation[4];
  /** Wrench that the frame applies to its surroundings by springs, dampers and desired force, N and N·m. */
  double wrench[6];
  /** f_hat: wrench that the environment applies to the frame, N and N·m. */
  double force_estimated[6];
  /** Bits of `frame_flags`. */
  uint32_t flags;
  /** Fills the record to a multiple of eight bytes. */
  uint32_t reserved;
} TorquedFrameCommanded;
TORQUED_SIZE(TorquedFrameCommanded, 160);

typedef struct TorquedCommandedRecord {
  /** The joints, in config order. */
  TorquedJointCommanded joints[64];
  /** The frames of mode Cartesian, in config order; all zeros while a client uses none. */
  TorquedFrameCommanded frames[4];
  /** Mode stand: bit s is 1 where the robot stands on the foot of F/T sensor s; 0 in other modes. */
  uint64_t stands_on;
} TorquedCommandedRecord;
TORQUED_SIZE(TorquedCommandedRecord, 9352);

typedef struct TorquedCycleRecord {
  /** Cycle number since start. */
  uint64_t sequence;
  /** Instant of the cycle, ns on the caller's clock. */
  uint64_t stamp_ns;
  /** Number of a `Mode`, that of this cycle: 0 hold, 1 torque, 2 inverse dynamics, 3 position, 4 Cartesian. */
  uint32_t mode;
  /** Number of the latched fault's event, or 0. */
  uint32_t fault;
  /** Number of a `RobotState`: 0 boot, 1 ready, 2 enabling, 3 holding, 4 active, 5 stopping, 6 fault. */
  uint32_t state;
  /** Operators' requests since start. */
  uint32_t requests;
  /** Why the last request was refused, or 0: its kind (1 state, 2 joint not plausible, 3 joint outside its limits, 4 another fault, 5 a drive's own fault) times 65536, plus the number of the state or fault, or the joint's index. */
  uint32_t refusal;
  /** The subject of the latched fault, or 0 if it has none: its kind (1 joint, 2 F/T sensor, 3 IMU) times 65536, plus its index. */
  uint32_t fault_subject;
  /** Modes that the sources allow at present, a bit for each number of a `Mode`. */
  uint32_t possible_modes;
  /** Fills the record to a multiple of eight bytes. */
  uint32_t reserved;
  /** The client that commands. */
  TorquedCommanderRecord commander;
  /** Joints in use. */
  uint32_t joint_count;
  /** F/T sensors in use. */
  uint32_t ft_count;
  /** Measured values. */
  TorquedMeasuredRecord measured;
  /** Torques and contact wrenches estimated from them. */
  TorquedEstimatedRecord estimated;
  /** Commands to the drives. */
  TorquedCommandedRecord commanded;
  /** Count of each event since start, in the order of `Event::ALL`. */
  uint64_t events[64];
} TorquedCycleRecord;
TORQUED_SIZE(TorquedCycleRecord, 31776);

typedef struct TorquedLoopRecord {
  /** Cycles run. */
  uint64_t cycles;
  /** Cycles that ended after the next one should have begun. */
  uint64_t late_cycles;
  /** Cycles that were left out because an earlier one ended too late. */
  uint64_t skipped_cycles;
  /** Lateness of the thread's wake-up, ns. */
  uint64_t wake_late_ns;
  /** Time from SYNC until every joint had answered or the deadline had passed, ns. */
  uint64_t gather_ns;
  /** Computing time of the cycle, ns. */
  uint64_t compute_ns;
  /** Time to hand the commands to the bus, ns. */
  uint64_t send_ns;
  /** Frames received since start. */
  uint64_t frames_received;
  /** Frames sent since start. */
  uint64_t frames_sent;
} TorquedLoopRecord;
TORQUED_SIZE(TorquedLoopRecord, 72);

typedef struct TorquedSharedRecord {
  /** The cycle. */
  TorquedCycleRecord cycle;
  /** The loop around it. */
  TorquedLoopRecord timing;
} TorquedSharedRecord;
TORQUED_SIZE(TorquedSharedRecord, 31848);

typedef struct TorquedDescription {
  /** The robot's name. */
  char robot[48];
  /** Cycles a second, Hz. */
  double rate_hz;
  /** Joints in use. */
  uint32_t joint_count;
  /** F/T sensors in use. */
  uint32_t ft_count;
  /** Names of the joints, in the order of every record's `joints`. */
  char joint_names[64][48];
  /** Names of the F/T sensors, in the order of every record's `ft`. */
  char ft_names[8][48];
  /** Kinds of the joints, numbers of `JointKind`. Of a prismatic joint every link-side quantity of every record is in m where its documentation has rad, and in N where it has N·m. */
  uint32_t joint_kinds[64];
  /** Torque limits of the joints, N·m. */
  double torque_limits[64];
  /** Lower position limits of the joints, rad. */
  double position_min[64];
  /** Upper position limits of the joints, rad. */
  double position_max[64];
  /** Contact sets in use. */
  uint32_t contact_set_count;
  /** Frames that mode Cartesian can lead. */
  uint32_t frame_count;
  /** Names of the contact sets; the first is in use at the start. */
  char contact_set_names[16][48];
  /** Names of the frames, in the order of every record's `frames`. */
  char frame_names[4][48];
} TorquedDescription;
TORQUED_SIZE(TorquedDescription, 6280);

typedef struct TorquedJointReference {
  /** q_d: desired joint angle, rad, or the target (mode position). */
  double q_d;
  /** dq_d: desired velocity, rad/s, or the greatest speed on the way to the target, 0 for the configured one (mode position). */
  double dq_d;
  /** ddq_d: desired acceleration, rad/s² (modes inverse dynamics, Cartesian and low-gain tracking). */
  double ddq_d;
  /** tau_d: desired torque, N·m (mode torque). */
  double tau_d;
  /** K_s: stiffness, N·m/rad, at most the configured one; counts where `gains_given` is 1 (not in mode torque). */
  double stiffness;
  /** K_d: damping, N·m·s/rad, at most the configured one, and no smaller a share of it than `stiffness` is of the configured stiffness; counts as `stiffness` does. */
  double damping;
} TorquedJointReference;
TORQUED_SIZE(TorquedJointReference, 48);

typedef struct TorquedFrameReference {
  /** x_d: desired position of the frame's origin in its base, m. */
  double position[3];
  /** R_d: desired orientation of the frame in its base, a unit quaternion w x y z. */
  double orientation[4];
  /** v_d: desired velocity, linear m/s and angular rad/s. */
  double velocity[6];
  /** K: stiffness along and about each axis, N/m and N·m/rad. */
  double stiffness[6];
  /** f_d: desired force and torque that the environment applies to the frame, N and N·m: a robot that presses down on a table gets an upward force. */
  double force[6];
  /** zeta: damping ratio of the springs with the limb's inertia, 0.3 to 2. */
  double damping_ratio;
  /** 1: the frame is led; 0: it is not. Together with mode hold: its pose is shown. */
  uint32_t used;
  /** 1: stiffness, velocity and force are along the axes of the desired orientation; 0: along those of the base. */
  uint32_t own_axes;
  /** Axes on which K_f feeds the force back, a bit for each: x y z of force, x y z of torque; their stiffness must be 0. */
  uint32_t force_axes;
  /** Fills the record to a multiple of eight bytes. */
  uint32_t reserved;
} TorquedFrameReference;
TORQUED_SIZE(TorquedFrameReference, 224);

typedef struct TorquedReference {
  /** Session of the commander: a random number other than 0, a new one whenever it asks for the lease. */
  uint64_t session;
  /** Instant at which the session began, ns on the machine's `CLOCK_MONOTONIC`. A session older than one that has had the lease never gets it. */
  uint64_t session_began_ns;
  /** Count of the session's references, this one included: it must advance. */
  uint64_t sequence;
  /** Instant of sending, ns on the machine's `CLOCK_MONOTONIC`: the reference's age counts from it. */
  uint64_t sent_ns;
  /** Trajectory whose points give `q_d dq_d ddq_d` of every cycle, or 0: those of this reference (modes inverse dynamics, torque-feedback motion and low-gain tracking). It counts from the trajectory's first piece on. */
  uint64_t trajectory;
  /** Mode passive: bit k is 1 where joint k is held at `q_d`, with its `stiffness` and `damping` or the configured ones; the other joints are let go. */
  uint64_t held_joints;
  /** Number of a `Mode`: 0 hold, 1 torque, 2 inverse dynamics, 3 position, 4 Cartesian, 5 passive, 6 torque-feedback motion, 7 low-gain tracking, 8 velocity, 9 stand. */
  uint32_t mode;
  /** Joints in use; must equal the robot's. */
  uint32_t joint_count;
  /** Priority of the session, that of its first reference: it takes the lease over from a session of lower priority. */
  uint32_t priority;
  /** Process of the commander, to be named to others. */
  uint32_t pid;
  /** 1: the last reference of its session, which gives the lease back; the robot holds. */
  uint32_t gives_back;
  /** 1: `contact_wrench` is followed; 0: what the ground carries in the desired motion is. */
  uint32_t contact_wrench_given;
  /** 1: the joints' `stiffness` and `damping` hold; 0: those of the configuration for the mode. */
  uint32_t gains_given;
  /** Mode stand: bit s is 1 where the client lifts the foot of F/T sensor s. The robot stands on the others alone before it is free (`stands_on` of the record), then its joints follow `q_d` from where they are. */
  uint32_t lifted_feet;
  /** The joints, in config order. */
  TorquedJointReference joints[64];
  /** f_d: desired wrench of the environment on each end-effector, at the frame of its F/T sensor, in config order (mode inverse dynamics). */
  TorquedWrench contact_wrench[8];
  /** The frames, in config order (mode Cartesian). */
  TorquedFrameReference frames[4];
  /** Mode stand: horizontal offset of the centre of mass from the middle of the soles that bear the robot, forward and to the left as the base stood when the mode began, m. */
  double center_of_mass_offset[2];
} TorquedReference;
TORQUED_SIZE(TorquedReference, 4448);

typedef struct TorquedJointPoint {
  /** q_d, rad. */
  double q_d;
  /** dq_d, rad/s. */
  double dq_d;
  /** ddq_d, rad/s². */
  double ddq_d;
} TorquedJointPoint;
TORQUED_SIZE(TorquedJointPoint, 24);

typedef struct TorquedTrajectoryPoint {
  /** The joints, in config order. */
  TorquedJointPoint joints[64];
} TorquedTrajectoryPoint;
TORQUED_SIZE(TorquedTrajectoryPoint, 1536);

typedef struct TorquedTrajectoryPiece {
  /** Session of the commander. */
  uint64_t session;
  /** Number of the trajectory, of the client's choice, other than 0; references name it. */
  uint64_t trajectory;
  /** Count of the session's pieces, this one included: it must advance. */
  uint64_t sequence;
  /** Time of the first point since the trajectory's begin, ns. The trajectory begins in the cycle that first follows it; its first piece has 0 here. */
  uint64_t begins_ns;
  /** Time between two points, ns. */
  uint64_t spacing_ns;
  /** Joints in use; must equal the robot's. */
  uint32_t joint_count;
  /** Points in use, at least 2. */
  uint32_t point_count;
  /** The points. */
  TorquedTrajectoryPoint points[32];
} TorquedTrajectoryPiece;
TORQUED_SIZE(TorquedTrajectoryPiece, 49200);

typedef struct TorquedCommanderStatus {
  /** Cycle number since the daemon's start. */
  uint64_t cycle;
  /** The lease, and whether references are followed. */
  TorquedCommanderRecord commander;
  /** Number of the robot's `RobotState`. */
  uint32_t state;
  /** Number of the robot's `Mode`. */
  uint32_t mode;
} TorquedCommanderStatus;
TORQUED_SIZE(TorquedCommanderStatus, 136);

typedef struct TorquedRequest {
  /** Any number that no other request has: the answers repeat it. */
  uint64_t id;
  /** One of `request`. */
  uint32_t kind;
  /** Number of the fault to acknowledge; 0 in other requests. */
  uint32_t fault;
  /** Name of a contact set, for a tare and for the choice of a contact set. */
  char contact_set[48];
  /** Duration of a recording from now on, s; negative: until its end is asked for. */
  double seconds;
  /** Time before now that is recorded too, s. */
  double last_s;
  /** tau: torque that the joint is known to carry, N·m, and its standard deviation. */
  double torque;
  /** See `torque`. */
  double sigma;
  /** Messages a second of a recording of torques; 0: one for each cycle. */
  double rate_hz;
  /** Number of a recording's `Content`: 0 all, 1 frames, 2 torques. */
  uint32_t content;
  /** Fills the record to a multiple of eight bytes. */
  uint32_t reserved;
  /** 1: a recording may replace the file `path`. */
  uint32_t overwrite;
  /** Index of the joint to tare, in config order. */
  uint32_t joint;
  /** Absolute path of the file to record into, as the daemon sees it. */
  char path[1024];
} TorquedRequest;
TORQUED_SIZE(TorquedRequest, 1144);

typedef struct TorquedTaredSensor {
  /** Offset of the tare; it is subtracted from the reading in addition to the configuration's offset. */
  TorquedWrench offset;
  /** The same before this request. */
  TorquedWrench before;
  /** Standard deviation of `offset`; zero without a tare. */
  TorquedWrench sigma;
  /** Bit k: the tare's pose determined component k (fx fy fz tx ty tz) of `offset`. */
  uint32_t known;
  /** Fills the record to a multiple of eight bytes. */
  uint32_t reserved;
} TorquedTaredSensor;
TORQUED_SIZE(TorquedTaredSensor, 152);

typedef struct TorquedAnswer {
  /** The request's `id`. */
  uint64_t id;
  /** One of `answer_status`. */
  uint32_t status;
  /** F/T sensors in use. */
  uint32_t ft_count;
  /** Share of the work that is done, 0 to 1. */
  double progress;
  /** Date of the last tare, seconds since 1970-01-01 UTC; zero if there is none. */
  double date_unix_s;
  /** Contact set of that tare. */
  char contact_set[48];
  /** A sentence about what is being done, was done, or was refused and why. */
  char text[1024];
  /** The F/T sensors, in config order; filled in answers about tares. */
  TorquedTaredSensor ft[8];
} TorquedAnswer;
TORQUED_SIZE(TorquedAnswer, 2320);

#undef TORQUED_SIZE

#endif
