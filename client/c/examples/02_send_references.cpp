// A controller: moves the first joint 2 degrees to and fro by inverse dynamics, one reference for each of the
// daemon's records, for five seconds or as many as the second argument says.
//
//     c++ -std=c++17 02_send_references.cpp $(pkg-config --cflags --libs torqued) -o send_references
//     ./send_references leg
#include <cmath>
#include <iostream>
#include <torqued/torqued.hpp>

int main(int argc, char** argv) try {
  torqued::Client client(argc > 1 ? argv[1] : "");
  const double seconds = argc > 2 ? std::stod(argv[2]) : 5.0, pi = std::acos(-1.0);
  torqued::Commander commander(client);  // holds the robot where it stands
  commander.hold_until_ready(torqued::Seconds(10.0));
  client.latest_record();  // skips records from before
  auto record = client.next_record();
  const double start_q = record->cycle.measured.joints[0].q, w = pi;  // 0.5 Hz
  const auto start_ns = record->cycle.stamp_ns;
  const auto& robot = client.description();
  const double middle = 0.5 * (robot.position_min[0] + robot.position_max[0]);
  const double half = std::copysign(pi / 180.0, middle - start_q);  // away from the nearer limit
  std::uint64_t cycles = 0, lost = 0;
  for (double t = 0.0; t < seconds; t = 1e-9 * double(record->cycle.stamp_ns - start_ns)) {
    auto& reference = commander.reference();
    reference.mode = TORQUED_MODE_INVERSE_DYNAMICS;
    reference.joints[0].q_d = start_q + half * (1.0 - std::cos(w * t));  // begins at rest, and smoothly
    reference.joints[0].dq_d = half * w * std::sin(w * t);
    reference.joints[0].ddq_d = half * w * w * std::cos(w * t);
    commander.send();  // throws if earlier ones are not followed
    record = client.next_record();
    cycles += 1, lost += record.lost;
  }
  commander.close();
  std::cout << cycles << " references sent, " << lost << " records lost\n";
} catch (const std::exception& error) {
  std::cerr << error.what() << '\n';
  return 1;
}
