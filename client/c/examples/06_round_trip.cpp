// Measures how soon a reference is seen in a record: from its sending to the first record of a cycle that followed
// it. The robot only holds. Prints one line of JSON.
//
//     c++ -O2 -std=c++17 06_round_trip.cpp $(pkg-config --cflags --libs torqued) -o round_trip
//     ./round_trip leg 10
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <iostream>
#include <string>
#include <torqued/torqued.hpp>
#include <vector>

// A reference that no cycle has followed by then came after its lease had ended: this program was kept from running.
constexpr double unanswered_ms = 100.0;

int main(int argc, char** argv) try {
  using clock = std::chrono::steady_clock;
  using Milliseconds = std::chrono::duration<double, std::milli>;
  torqued::Client client(argc > 1 ? argv[1] : "");
  const torqued::Seconds duration(argc > 2 ? std::stod(argv[2]) : 10.0);
  torqued::Commander commander(client);
  client.latest_record();  // skips records from before
  std::vector<double> trips;
  unsigned long long records = 0, lost = 0, unanswered = 0;
  const auto begin = clock::now();
  while (clock::now() - begin < duration) {
    const auto sent = clock::now();
    commander.send();
    const auto sequence = commander.reference().sequence;
    for (;;) {
      const auto record = client.next_record();
      ++records, lost += record.lost;
      const double took = Milliseconds(clock::now() - sent).count();
      const bool followed = record->cycle.commander.sequence >= sequence;
      if (followed) trips.push_back(took);
      if (!followed && took > unanswered_ms) ++unanswered;
      if (followed || took > unanswered_ms) break;
    }
  }
  const double took = torqued::Seconds(clock::now() - begin).count();
  std::sort(trips.begin(), trips.end());
  auto at = [&](double share) { return trips[std::size_t(double(trips.size() - 1) * share)]; };
  std::printf("{\"records_per_s\": %.1f, \"lost\": %llu, \"unanswered\": %llu, ",
              double(records) / took, lost, unanswered);
  std::printf("\"p50_ms\": %.3f, \"p99_ms\": %.3f, \"max_ms\": %.3f}\n", at(0.5), at(0.99), at(1.0));
  commander.close();
} catch (const std::exception& error) {
  std::cerr << error.what() << '\n';
  return 1;
}
