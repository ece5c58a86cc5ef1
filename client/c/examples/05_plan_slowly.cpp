// A controller that plans: it computes for 150 ms at a time, longer than the lease lasts (40 ms unless configured).
// A thread of the library keeps the lease meanwhile, and the robot goes on as the newest reference says: the
// first joint 2 degrees to and fro, for three seconds.
//
//     c++ -std=c++17 05_plan_slowly.cpp $(pkg-config --cflags --libs torqued) -o plan_slowly
//     ./plan_slowly leg
#include <chrono>
#include <cmath>
#include <iostream>
#include <thread>
#include <torqued/torqued.hpp>

int main(int argc, char** argv) try {
  using torqued::Seconds;
  torqued::Client client(argc > 1 ? argv[1] : "");
  torqued::Commander commander(client);
  commander.hold_until_ready(Seconds(10.0));
  // Silent for longer than half a second, the program has failed: the lease ends, and the robot holds.
  commander.keep(Seconds(0.5), torqued::Meanwhile::extrapolate);
  client.latest_record();  // skips records from before
  const auto record = client.next_record();
  const double start_q = record->cycle.measured.joints[0].q, w = std::acos(-1.0);  // 0.5 Hz
  const auto& robot = client.description();
  const double middle = 0.5 * (robot.position_min[0] + robot.position_max[0]);
  const double half = std::copysign(w / 180.0, middle - start_q);  // away from the nearer limit
  const auto begin = std::chrono::steady_clock::now();
  int plans = 0;
  for (Seconds t(0.0); t < Seconds(3.0); t = std::chrono::steady_clock::now() - begin) {
    auto& joint = commander.reference().joints[0];
    commander.reference().mode = TORQUED_MODE_INVERSE_DYNAMICS;
    joint.q_d = start_q + half * (1.0 - std::cos(w * t.count()));
    joint.dq_d = half * w * std::sin(w * t.count());
    joint.ddq_d = half * w * w * std::cos(w * t.count());
    commander.send();  // throws if earlier ones, also the thread's, are not followed
    std::this_thread::sleep_for(std::chrono::milliseconds(150));  // in place of a planner
    ++plans;
  }
  commander.close();
  std::cout << plans << " plans, the lease kept\n";
} catch (const std::exception& error) {
  std::cerr << error.what() << '\n';
  return 1;
}
