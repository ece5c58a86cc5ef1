/* libtorqued: joint torques of a robot that torqued runs, and references for it, by shared memory.
 *
 * Every function returns a TorquedCode and gives its results through pointers; the code's words are
 * torqued_message(). A handle may be used by one thread at a time, and different handles by different
 * threads. Made by cbindgen from client/c/src, do not edit. */

#ifndef TORQUED_H
#define TORQUED_H

#include <stddef.h>
#include <stdint.h>
#include <stdbool.h>
#include "torqued/records.h"

/**
 * Result of a function. Numbers keep their meaning in later versions.
 */
enum TorquedCode
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  /**
   * It is done.
   */
  TORQUED_CODE_OK = 0,
  /**
   * An argument cannot be used: a null pointer, a text that is not UTF-8, a negative time.
   */
  TORQUED_CODE_ARGUMENT = 1,
  /**
   * The run directory cannot be used.
   */
  TORQUED_CODE_RUN_DIRECTORY = 2,
  /**
   * Shared memory is full.
   */
  TORQUED_CODE_NO_ROOM = 3,
  /**
   * No daemon runs for that robot.
   */
  TORQUED_CODE_NO_DAEMON = 4,
  /**
   * The robot does not have that frame.
   */
  TORQUED_CODE_NO_FRAME = 5,
  /**
   * No record has arrived in time.
   */
  TORQUED_CODE_NO_RECORD = 6,
  /**
   * The daemon has stopped or was killed.
   */
  TORQUED_CODE_GONE = 7,
  /**
   * No robot was named, and none or several run.
   */
  TORQUED_CODE_WHICH_ROBOT = 8,
  /**
   * Daemon and client are of different versions.
   */
  TORQUED_CODE_OTHER_LAYOUT = 9,
  /**
   * Another client commands the robot.
   */
  TORQUED_CODE_ALREADY_COMMANDED = 10,
  /**
   * This client no longer commands the robot; ask for mode hold to get it again.
   */
  TORQUED_CODE_COMMAND_LOST = 11,
  /**
   * References are not followed, though this client commands the robot.
   */
  TORQUED_CODE_NOT_FOLLOWED = 12,
  /**
   * A piece of a trajectory was refused; the robot holds.
   */
  TORQUED_CODE_PIECE_REFUSED = 13,
  /**
   * A trajectory ended in motion; the robot was brought to rest.
   */
  TORQUED_CODE_TRAJECTORY_ENDED = 14,
  /**
   * The greatest number of clients command, or try to.
   */
  TORQUED_CODE_TOO_MANY_COMMANDERS = 15,
  /**
   * The greatest number of clients have requests open.
   */
  TORQUED_CODE_TOO_MANY_REQUESTS = 16,
  /**
   * A request was not answered.
   */
  TORQUED_CODE_UNANSWERED = 17,
  /**
   * The daemon has refused a request, and nothing has changed.
   */
  TORQUED_CODE_REFUSED = 18,
  /**
   * Any other error of shared memory or of the operating system.
   */
  TORQUED_CODE_TRANSPORT = 19,
  /**
   * A defect of this library.
   */
  TORQUED_CODE_PANICKED = 20,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum TorquedCode TorquedCode;
#else
typedef int32_t TorquedCode;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * What the robot does while a program with a kept lease computes.
 */
enum TorquedMeanwhile
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  /**
   * It holds: it comes to rest within its limits.
   */
  TORQUED_MEANWHILE_HOLD = 0,
  /**
   * It goes on as the newest reference says: targets move on by their velocity and acceleration, torques
   * and forces stay.
   */
  TORQUED_MEANWHILE_EXTRAPOLATE = 1,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum TorquedMeanwhile TorquedMeanwhile;
#else
typedef uint32_t TorquedMeanwhile;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * A connection to a robot's daemon; it outlives the daemon.
 */
typedef struct TorquedClient TorquedClient;

/**
 * The right to command a robot, by lease: each reference renews it.
 */
typedef struct TorquedCommander TorquedCommander;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/**
 * Connects to the daemon that runs `robot`, or to the only one that runs if `robot` is null, waiting at
 * most `timeout_s` for it. `client` is to be closed by `torqued_disconnect`.
 *
 * # Safety
 * `robot` is null or a text; `client` points to room for a handle.
 */
TorquedCode torqued_connect(const char *robot,
                            double timeout_s,
                            struct TorquedClient **client);

/**
 * Closes a connection and releases its record. Null is allowed. Its commander may live on.
 *
 * # Safety
 * A handle that is not used again.
 */
void torqued_disconnect(struct TorquedClient *client);

/**
 * Names and constants of the robot, valid as long as the connection; they change when another daemon
 * takes over. Null if `client` is.
 *
 * # Safety
 * A handle, or null.
 */
const TorquedDescription *torqued_description(const struct TorquedClient *client);

/**
 * The next record in order, waiting at most `timeout_s`. `record` points into shared memory and is valid
 * until the next call with this client. `lost`, if not null: records lost since the last call, because
 * this client was too slow.
 *
 * # Safety
 * A handle; room for a pointer; room for a number, or null.
 */
TorquedCode torqued_next_record(struct TorquedClient *client,
                                double timeout_s,
                                const TorquedSharedRecord **record,
                                uint64_t *lost);

/**
 * The newest record, or null if none has arrived since the last call; those before it are skipped and not
 * counted as lost. Else as `torqued_next_record`.
 *
 * # Safety
 * As `torqued_next_record`.
 */
TorquedCode torqued_latest_record(struct TorquedClient *client,
                                  const TorquedSharedRecord **record,
                                  uint64_t *lost);

/**
 * Sends a request, all of its fields but `id` filled, and waits for its last answer. `progress`, if not
 * null, receives those before, each with `context`. `answer`: the last one, or null.
 *
 * # Safety
 * A handle; a request; a function that returns; room for an answer, or null.
 */
TorquedCode torqued_request(const struct TorquedClient *client,
                            const TorquedRequest *request,
                            void (*progress)(void *context, const TorquedAnswer *answer),
                            void *context,
                            TorquedAnswer *answer);

/**
 * Switches the drives on and waits until every joint is held where it stands.
 *
 * # Safety
 * A handle.
 */
TorquedCode torqued_enable(const struct TorquedClient *client);

/**
 * Ends all set-points and switches the drives off; waits until it is so.
 *
 * # Safety
 * A handle.
 */
TorquedCode torqued_disable(const struct TorquedClient *client);

/**
 * Brings the robot to rest and waits until it holds.
 *
 * # Safety
 * A handle.
 */
TorquedCode torqued_stop(const struct TorquedClient *client);

/**
 * Acknowledges the latched fault of that number, that of `TorquedCycleRecord::fault`.
 *
 * # Safety
 * A handle.
 */
TorquedCode torqued_acknowledge(const struct TorquedClient *client, uint32_t fault);

/**
 * Uses that contact set from now on, one of `TorquedDescription::contact_set_names`; null: the automatic
 * rule chooses it.
 *
 * # Safety
 * A handle; a text, or null.
 */
TorquedCode torqued_choose_contact_set(const struct TorquedClient *client,
                                       const char *name);

/**
 * Words of the last error that a function of this thread has returned, with its remedy, as UTF-8. They
 * are valid until the thread's next error; empty before the first one.
 */
const char *torqued_message(void);

/**
 * Takes the command of the client's robot. References begin with mode hold and `q_d` at the measured pose.
 * Waits until the daemon has given the lease, also to a robot that cannot move yet. A commander of lower
 * `priority` is replaced. `commander` is to be closed by `torqued_give_back`.
 *
 * # Safety
 * A handle; room for a handle.
 */
TorquedCode torqued_command(struct TorquedClient *client,
                            uint32_t priority,
                            struct TorquedCommander **commander);

/**
 * Gives the lease back and closes the handle, also after an error: the robot holds, and another client may
 * command at once. Null is allowed.
 *
 * # Safety
 * A handle that is not used again.
 */
TorquedCode torqued_give_back(struct TorquedCommander *commander);

/**
 * The reference that `torqued_send` sends next, for the caller to change: it is the one sent last. Valid as
 * long as the commander; null if `commander` is. Its session, count, time of sending, priority and
 * process are set when it is sent.
 *
 * # Safety
 * A handle, or null.
 */
TorquedReference *torqued_reference(struct TorquedCommander *commander);

/**
 * Sends the reference. To be called at least every `loop.reference_timeout_ms`: each reference renews the
 * lease, and a program that hangs loses it. After it was lost, a reference that asks for mode hold
 * begins anew. An error is about earlier references; this one was sent but for
 * `TORQUED_CODE_ALREADY_COMMANDED` and `TORQUED_CODE_COMMAND_LOST`.
 *
 * # Safety
 * A handle.
 */
TorquedCode torqued_send(struct TorquedCommander *commander);

/**
 * From now on a thread of the library keeps the lease while the program sends nothing for up to `busy_s`, at
 * most 1 s, and `meanwhile`, one of `TORQUED_MEANWHILE_...`, happens: for programs that compute for longer
 * than `loop.reference_timeout_ms` now and then. The thread has real-time priority where the process may. A
 * program that is silent for longer loses the lease as any other. Holds until `torqued_give_back`; after an
 * error of it the lease is lost, but for `TORQUED_CODE_ARGUMENT`.
 *
 * # Safety
 * A handle.
 */
TorquedCode torqued_keep(struct TorquedCommander *commander,
                         double busy_s,
                         uint32_t meanwhile);

/**
 * Asks for mode hold until a mode would be followed, waiting at most `timeout_s`: for a robot that an
 * operator is about to enable, or after an error of `torqued_send`.
 *
 * # Safety
 * A handle.
 */
TorquedCode torqued_hold_until_ready(struct TorquedCommander *commander,
                                     double timeout_s);

/**
 * The daemon's report of this moment: who commands, the robot's state, and whether and why no mode is
 * followed.
 *
 * # Safety
 * A handle; room for a report.
 */
TorquedCode torqued_status(struct TorquedCommander *commander,
                           TorquedCommanderStatus *status);

/**
 * Lets joints go, by mode passive: a hand can move them, the others hold. To be called as `torqued_send`.
 *
 * # Safety
 * A handle; `count` indices of joints.
 */
TorquedCode torqued_let_go(struct TorquedCommander *commander,
                           const size_t *joints,
                           size_t count);

/**
 * Prepares mode Cartesian with these frames: the robot holds until their poses are shown, and the reference
 * asks for these poses, without stiffness or force. The caller goes on by setting stiffness, force and
 * mode. `client`: of the same robot; its records are taken.
 *
 * # Safety
 * Two handles; `count` indices of frames.
 */
TorquedCode torqued_lead_frames(struct TorquedCommander *commander,
                                struct TorquedClient *client,
                                const size_t *frames,
                                size_t count);

/**
 * Sends the robot to the pose `q_d` of the reference, by mode position, and waits until it is there and
 * stays there. `dq_d` of a joint is its greatest speed on the way, 0 for the configured one. `going`, if
 * not null, is shown the time that the motion will still take, and returns false to bring the robot to
 * rest. `arrived`, if not null: whether it has arrived.
 *
 * # Safety
 * A handle; a function that returns; room for a flag, or null.
 */
TorquedCode torqued_go_to(struct TorquedCommander *commander,
                          bool (*going)(void *context, double left_s),
                          void *context,
                          bool *arrived);

/**
 * Follows a trajectory of `duration_s`, with points at most `spacing_s` apart (0.5 ms to 200 ms), from the
 * robot's present pose on, and waits until it has ended. `at` writes position, velocity and
 * acceleration of every joint at a time since the begin; it should begin at the present pose and end at
 * rest. `mode`: `TORQUED_MODE_INVERSE_DYNAMICS`, `..._TORQUE_FEEDBACK_MOTION` or `..._LOW_GAIN_TRACKING`.
 *
 * A thread of its own renews the lease meanwhile, and half a second of the trajectory is buffered: `at` and
 * `going` may take a tenth of a second now and then. `going`, if not null, is shown the time on the
 * trajectory and how long the robot can go on with what was sent, and returns false to bring it to
 * rest. `arrived`, if not null: whether the end was reached. Both functions run in the caller's thread.
 *
 * # Safety
 * A handle; functions that return; room for a flag, or null.
 */
TorquedCode torqued_follow(struct TorquedCommander *commander,
                           uint32_t mode,
                           double duration_s,
                           double spacing_s,
                           void (*at)(void *context,
                                      double t,
                                      TorquedJointPoint *joints,
                                      size_t count),
                           bool (*going)(void *context, double time_s, double buffered_s),
                           void *context,
                           bool *arrived);

/**
 * Name of a `TorquedMode`, e.g. `inverse_dynamics`; null for another number.
 */
const char *torqued_mode_name(uint32_t mode);

/**
 * Name of a `TorquedRobotState`, e.g. `holding`; null for another number.
 */
const char *torqued_state_name(uint32_t state);

/**
 * Number of the event whose count is `TorquedCycleRecord::events[index]`, e.g. 404; 0 beyond the last.
 */
uint32_t torqued_event_number(size_t index);

/**
 * Writes an event's name, cause and config key as one line of UTF-8, cut to `size` bytes with the zero at
 * its end. `number`: as in `TorquedCycleRecord::fault`. Returns the line's length without the zero; 0
 * if there is no such event.
 *
 * # Safety
 * `words` has room for `size` bytes, or is null with `size` 0.
 */
size_t torqued_event_words(uint32_t number,
                           char *words,
                           size_t size);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* TORQUED_H */
