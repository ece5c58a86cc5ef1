// Calls every function of the library, with what it allows and with what it refuses.

#include <chrono>
#include <cmath>
#include <iostream>
#include <stdexcept>
#include <string>
#include <thread>
#include <torqued/torqued.hpp>

namespace {

using torqued::Seconds;

void require(bool holds, const char* what) {
  if (!holds) throw std::logic_error(std::string(what) + "; last words: " + torqued_message());
}
#define REQUIRE(condition) require(condition, #condition)

template <class Call>
TorquedCode code_of(Call&& call, const char* words) {
  try {
    call();
  } catch (const torqued::Error& error) {
    REQUIRE(std::string(error.what()).find(words) != std::string::npos);
    return error.code();
  }
  return TORQUED_CODE_OK;
}

void null_pointers_are_refused() {
  TorquedClient* client = nullptr;
  const TorquedSharedRecord* record = nullptr;
  TorquedCommanderStatus status;
  REQUIRE(torqued_connect("leg", 1.0, nullptr) == TORQUED_CODE_ARGUMENT);
  REQUIRE(torqued_connect("leg", -1.0, &client) == TORQUED_CODE_ARGUMENT);
  REQUIRE(torqued_connect("leg", NAN, &client) == TORQUED_CODE_ARGUMENT);
  REQUIRE(torqued_connect("\xff", 1.0, &client) == TORQUED_CODE_ARGUMENT);
  REQUIRE(std::string(torqued_message()) == "robot is not UTF-8");
  REQUIRE(torqued_connect("nobody", 0.01, &client) == TORQUED_CODE_NO_DAEMON && !client);
  REQUIRE(torqued_next_record(nullptr, 1.0, &record, nullptr) == TORQUED_CODE_ARGUMENT);
  REQUIRE(torqued_latest_record(nullptr, &record, nullptr) == TORQUED_CODE_ARGUMENT);
  REQUIRE(torqued_request(nullptr, nullptr, nullptr, nullptr, nullptr) == TORQUED_CODE_ARGUMENT);
  REQUIRE(torqued_stop(nullptr) == TORQUED_CODE_ARGUMENT);
  REQUIRE(torqued_command(nullptr, 0, nullptr) == TORQUED_CODE_ARGUMENT);
  REQUIRE(torqued_send(nullptr) == TORQUED_CODE_ARGUMENT);
  REQUIRE(torqued_hold_until_ready(nullptr, 1.0) == TORQUED_CODE_ARGUMENT);
  REQUIRE(torqued_status(nullptr, &status) == TORQUED_CODE_ARGUMENT);
  REQUIRE(torqued_go_to(nullptr, nullptr, nullptr, nullptr) == TORQUED_CODE_ARGUMENT);
  REQUIRE(!torqued_description(nullptr) && !torqued_reference(nullptr));
  REQUIRE(torqued_give_back(nullptr) == TORQUED_CODE_OK);
  torqued_disconnect(nullptr);
}

void numbers_have_words() {
  REQUIRE(std::string(torqued_mode_name(TORQUED_MODE_INVERSE_DYNAMICS)) == "inverse_dynamics");
  REQUIRE(std::string(torqued_state_name(TORQUED_ROBOT_STATE_HOLDING)) == "holding");
  REQUIRE(!torqued_mode_name(99) && !torqued_state_name(99));
  REQUIRE(torqued_event_number(0) > 0 && torqued_event_number(TORQUED_EVENT_COUNT) == 0);
  REQUIRE(torqued::event_words(404).find("404 enable_time_out: ") == 0);
  REQUIRE(torqued::event_words(1).empty());
}

void requests_are_answered(torqued::Client& client) {
  client.enable(), client.disable(), client.stop(), client.acknowledge(404);
  client.automatic_contact_set(), client.choose_contact_set("in_the_air");
  REQUIRE(code_of([&] { client.choose_contact_set("moon"); }, "no moon; allowed: in_the_air") ==
          TORQUED_CODE_REFUSED);
  REQUIRE(code_of([&] { client.choose_contact_set(std::string(49, 'x')); }, "49 bytes") ==
          TORQUED_CODE_ARGUMENT);
  TorquedRequest tare{};
  tare.kind = TORQUED_REQUEST_KIND_TARE;
  int shown = 0;
  REQUIRE(client.request(tare, [&](const TorquedAnswer&) { ++shown; }).ft[0].offset.torque[2] == 6.0);
  REQUIRE(shown == 1);
  // An exception of the caller does not cross the library: it is thrown again behind it.
  try {
    client.request(tare, [](const TorquedAnswer&) { throw std::runtime_error("mine"); });
    REQUIRE(false);
  } catch (const std::runtime_error& error) {
    REQUIRE(std::string(error.what()) == "mine");
  }
}

void a_robot_is_commanded(torqued::Client& client) {
  torqued::Commander commander(client);
  REQUIRE(code_of([&] { torqued::Commander second(client); }, "commanded by another client") ==
          TORQUED_CODE_ALREADY_COMMANDED);
  commander.hold_until_ready(Seconds(5.0));
  REQUIRE(commander.status().commander.session == commander.reference().session);
  commander.reference().mode = TORQUED_MODE_TORQUE;
  commander.reference().joints[3].q_d = 0.25;
  commander.send();
  auto record = client.next_record();
  while (record->cycle.mode != TORQUED_MODE_TORQUE) record = client.next_record();
  REQUIRE(record->cycle.measured.joints[3].q == 0.25);
  REQUIRE(commander.go_to());
  REQUIRE(!commander.go_to([](Seconds) { return false; }));
  commander.let_go({1});
  REQUIRE(commander.reference().held_joints == ~std::uint64_t{2});
  commander.lead_frames(client, {0});
  REQUIRE(commander.reference().frames[0].used == 1);
  REQUIRE(code_of([&] { commander.lead_frames(client, {7}); }, "none of index 7") ==
          TORQUED_CODE_NO_FRAME);
  auto rest = [](double, TorquedJointPoint* joints, std::size_t count) {
    for (std::size_t j = 0; j < count; ++j) joints[j] = {j == 3 ? 0.25 : 0.0, 0.0, 0.0};
  };
  REQUIRE(commander.follow(Seconds(0.3), Seconds(0.02), rest));
  auto flight = [](double t, TorquedJointPoint* joints, std::size_t count) {
    for (std::size_t j = 0; j < count; ++j) joints[j] = {9.0 * t, 9.0, 0.0};
  };
  REQUIRE(code_of([&] { commander.follow(Seconds(0.3), Seconds(0.02), flight); }, "limits of position") ==
          TORQUED_CODE_PIECE_REFUSED);
  auto on = [](torqued::Progress) { return true; };
  REQUIRE(code_of([&] { commander.follow(Seconds(1), Seconds(0.02), rest, on, TORQUED_MODE_TORQUE); },
                  "follows no trajectory") == TORQUED_CODE_ARGUMENT);
  commander.close();
}

void a_lease_is_kept_while_the_program_is_busy(torqued::Client& client) {
  using torqued::Meanwhile;
  for (auto meanwhile : {Meanwhile::hold, Meanwhile::extrapolate}) {
    torqued::Commander commander(client);
    commander.hold_until_ready(Seconds(5.0));
    REQUIRE(code_of([&] { commander.keep(Seconds(1.1), meanwhile); }, "at most 1 s") ==
            TORQUED_CODE_ARGUMENT);
    REQUIRE(torqued_keep(nullptr, 1.0, 0) == TORQUED_CODE_ARGUMENT);
    commander.keep(Seconds(1.0), meanwhile);
    REQUIRE(code_of([&] { commander.keep(Seconds(1.0), meanwhile); }, "already") ==
            TORQUED_CODE_ARGUMENT);
    auto& reference = commander.reference();
    reference.mode = TORQUED_MODE_INVERSE_DYNAMICS;
    reference.joints[2].q_d = 0.0, reference.joints[2].dq_d = 1.0;
    commander.send();
    const auto sent = commander.reference().sequence;
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
    client.latest_record();
    auto record = client.next_record();
    REQUIRE(record->cycle.commander.sequence > sent + 5);
    const bool held = record->cycle.mode == TORQUED_MODE_HOLD;
    REQUIRE(held == (meanwhile == Meanwhile::hold));
    REQUIRE(held || record->cycle.measured.joints[2].q > 0.1);
    // What the thread has sent changes nothing of the caller's reference.
    REQUIRE(reference.mode == TORQUED_MODE_INVERSE_DYNAMICS && reference.joints[2].q_d == 0.0);
    commander.status();
    REQUIRE(commander.go_to());
    commander.close();
  }
}

}  // namespace

int main(int argc, char** argv) try {
  null_pointers_are_refused();
  numbers_have_words();
  torqued::Client client(argc > 1 ? argv[1] : "");
  torqued::Client only;  // the only robot that runs
  REQUIRE(client.joint_count() == 6 && client.joint("joint_2") == 2);
  REQUIRE(client.joint(std::string(48, 'x')) == 5);
  const auto first = client.next_record();
  const auto sequence = first->cycle.sequence;
  REQUIRE(client.next_record()->cycle.sequence == sequence + 1);
  while (!client.latest_record()) {
  }
  requests_are_answered(client);
  a_robot_is_commanded(client);
  a_lease_is_kept_while_the_program_is_busy(client);
  std::cout << "all as promised\n";
} catch (const std::exception& error) {
  std::cerr << error.what() << '\n';
  return 1;
}
