// Follows a trajectory that is sent ahead: every joint 2 degrees there and back in two seconds. The lease is
// renewed by a thread of the library; this program may take its time.
//
//     c++ -std=c++17 04_follow_trajectory.cpp $(pkg-config --cflags --libs torqued) -o follow_trajectory
//     ./follow_trajectory leg
#include <cmath>
#include <iostream>
#include <torqued/torqued.hpp>
#include <vector>

int main(int argc, char** argv) try {
  using torqued::Seconds;
  torqued::Client client(argc > 1 ? argv[1] : "");
  torqued::Commander commander(client);
  commander.hold_until_ready(Seconds(10.0));
  client.latest_record();  // skips records from before
  const auto record = client.next_record();
  std::vector<double> start, half;
  for (std::size_t j = 0; j < client.joint_count(); ++j) {
    const auto& robot = client.description();
    start.push_back(record->cycle.measured.joints[j].q);
    const double middle = 0.5 * (robot.position_min[j] + robot.position_max[j]);
    half.push_back(std::copysign(std::acos(-1.0) / 180.0, middle - start[j]));
  }
  // (t (T - t))^3, scaled: position, velocity and acceleration are 0 at both ends.
  const double duration = 2.0, scale = 2.0 * std::pow(4.0 / (duration * duration), 3);
  auto at = [&](double t, TorquedJointPoint* joints, std::size_t count) {
    const double u = t * (duration - t), du = duration - 2.0 * t;
    for (std::size_t j = 0; j < count; ++j) {
      joints[j].q_d = start[j] + half[j] * scale * u * u * u;
      joints[j].dq_d = half[j] * scale * 3.0 * u * u * du;
      joints[j].ddq_d = half[j] * scale * (6.0 * u * du * du - 6.0 * u * u);
    }
  };
  auto going = [](torqued::Progress progress) { return progress.time < Seconds(60.0); };
  const bool arrived = commander.follow(Seconds(duration), Seconds(0.02), at, going);
  std::cout << (arrived ? "arrived" : "ended on the way") << '\n';
} catch (const std::exception& error) {
  std::cerr << error.what() << '\n';
  return 1;
}
