/* Tares the F/T sensors of a robot that hangs still in its harness, and prints their offsets.
 *
 *     cc 03_tare.c $(pkg-config --cflags --libs torqued) -o tare
 *     ./tare leg in_the_air */

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <torqued/torqued.h>

static void working(void *context, const TorquedAnswer *answer) {
  (void)context;
  fprintf(stderr, "%3.0f %%, keep the robot still\n", 100.0 * answer->progress);
}

int main(int argc, char **argv) {
  TorquedClient *client;
  TorquedRequest request = {.kind = TORQUED_REQUEST_KIND_TARE};
  TorquedAnswer answer;
  /* The present contact set, one of the robot's configuration. */
  strncpy(request.contact_set, argc > 2 ? argv[2] : "in_the_air", sizeof request.contact_set);
  TorquedCode code = torqued_connect(argc > 1 ? argv[1] : NULL, 2.0, &client);
  if (code == TORQUED_CODE_OK) code = torqued_request(client, &request, working, NULL, &answer);
  if (code != TORQUED_CODE_OK) {
    fprintf(stderr, "%s\n", torqued_message());
    torqued_disconnect(client);
    return EXIT_FAILURE;
  }
  printf("%.1024s\n", answer.text);
  const TorquedDescription *robot = torqued_description(client);
  for (uint32_t i = 0; i < answer.ft_count; ++i) {
    const double *force = answer.ft[i].offset.force;
    printf("  %-24.48s %8.2f %8.2f %8.2f N\n", robot->ft_names[i], force[0], force[1], force[2]);
  }
  torqued_disconnect(client);
  return EXIT_SUCCESS;
}
