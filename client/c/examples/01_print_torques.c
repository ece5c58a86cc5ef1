/* Prints every joint's torque ten times a second, for some seconds or until the daemon ends.
 *
 *     cc 01_print_torques.c $(pkg-config --cflags --libs torqued) -o print_torques
 *     ./print_torques leg 5 */

#include <stdio.h>
#include <stdlib.h>

#include <torqued/torqued.h>

int main(int argc, char **argv) {
  TorquedClient *client;
  const double seconds = argc > 2 ? atof(argv[2]) : 1e9;
  if (torqued_connect(argc > 1 ? argv[1] : NULL, 2.0, &client) != TORQUED_CODE_OK) {
    fprintf(stderr, "%s\n", torqued_message());
    return EXIT_FAILURE;
  }
  const TorquedDescription *robot = torqued_description(client);
  const TorquedSharedRecord *record;
  const double cycles = seconds * robot->rate_hz;
  uint64_t lost, all_lost = 0;
  TorquedCode code;
  for (double cycle = 0;
       (code = torqued_next_record(client, 1.0, &record, &lost)) == TORQUED_CODE_OK && cycle < cycles;
       ++cycle) {
    all_lost += lost;
    if (record->cycle.sequence % 100 != 0) continue;
    printf("cycle %llu (%llu records lost)\n", (unsigned long long)record->cycle.sequence,
           (unsigned long long)all_lost);
    for (uint32_t j = 0; j < robot->joint_count; ++j) {
      const TorquedJointEstimated *joint = &record->cycle.estimated.joints[j];
      /* A name has at most 48 bytes, and may have no zero at its end. */
      printf("  %-24.48s encoder %8.2f +- %5.2f N m, whole-body %8.2f +- %5.2f N m\n",
             robot->joint_names[j], joint->tau_encoder.tau, joint->tau_encoder.sigma,
             joint->tau_whole_body.tau, joint->tau_whole_body.sigma);
    }
  }
  if (code != TORQUED_CODE_OK) fprintf(stderr, "%s\n", torqued_message());
  torqued_disconnect(client);
  return code == TORQUED_CODE_OK ? EXIT_SUCCESS : EXIT_FAILURE;
}
