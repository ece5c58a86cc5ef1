/* libtorqued for C++17: handles that close themselves, times as std::chrono, errors as exceptions.
 *
 *     torqued::Client client("leg");
 *     auto record = client.next_record(1s);
 *     std::cout << record->cycle.estimated.joints[3].tau_encoder.tau << '\n';
 *
 * The records are the structs of records.h. A record is read in place, in shared memory, and is valid until
 * the client's next one. Header only: nothing of C++ crosses the library's boundary. */

#ifndef TORQUED_HPP
#define TORQUED_HPP

#include <chrono>
#include <cstring>
#include <exception>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "torqued/torqued.h"

namespace torqued {

/** A function of the library has not done its work; what() says why, and the remedy. */
class Error : public std::runtime_error {
 public:
  Error(TorquedCode code, const std::string& words) : std::runtime_error(words), code_(code) {}
  /** One of TORQUED_CODE_... */
  TorquedCode code() const noexcept { return code_; }

 private:
  TorquedCode code_;
};

using Seconds = std::chrono::duration<double>;

namespace detail {

inline void check(TorquedCode code) {
  if (code != TORQUED_CODE_OK) throw Error(code, torqued_message());
}

/** Functions of the caller for the library's callbacks: what they throw is thrown again after the call. */
class Thrown {
 public:
  template <class Call>
  bool keep(Call&& call) noexcept {
    if (error_) return false;
    try {
      return call();
    } catch (...) {
      error_ = std::current_exception();
      return false;
    }
  }
  void rethrow() const {
    if (error_) std::rethrow_exception(error_);
  }

 private:
  std::exception_ptr error_;
};

}  // namespace detail

/** A text of a record: at most N bytes, with or without a zero at its end. */
template <std::size_t N>
std::string_view text(const char (&bytes)[N]) {
  const void* end = std::memchr(bytes, 0, N);
  return {bytes, end ? static_cast<std::size_t>(static_cast<const char*>(end) - bytes) : N};
}

/** An event's name, cause and config key; `number` as in TorquedCycleRecord::fault. */
inline std::string event_words(std::uint32_t number) {
  std::string words(torqued_event_words(number, nullptr, 0) + 1, '\0');
  words.resize(torqued_event_words(number, words.data(), words.size()));
  return words;
}

/** A record in shared memory, and the records lost before it. */
struct Record {
  const TorquedSharedRecord* record;
  std::uint64_t lost;
  const TorquedSharedRecord* operator->() const noexcept { return record; }
  const TorquedSharedRecord& operator*() const noexcept { return *record; }
};

/** A connection to a robot's daemon; it outlives the daemon. */
class Client {
 public:
  /** Connects to the daemon that runs `robot`, or to the only one that runs if it is empty. */
  explicit Client(const std::string& robot = {}, Seconds timeout = Seconds(2.0)) {
    TorquedClient* client = nullptr;
    detail::check(torqued_connect(robot.empty() ? nullptr : robot.c_str(), timeout.count(), &client));
    client_.reset(client);
  }

  const TorquedDescription& description() const { return *torqued_description(client_.get()); }

  std::size_t joint_count() const { return description().joint_count; }

  /** A joint's place in config order. */
  std::size_t joint(std::string_view name) const {
    const TorquedDescription& robot = description();
    for (std::size_t j = 0; j < robot.joint_count; ++j)
      if (text(robot.joint_names[j]) == name) return j;
    throw std::invalid_argument("no joint \"" + std::string(name) + "\" in this robot");
  }

  /** The next record in order. */
  Record next_record(Seconds timeout = Seconds(1.0)) {
    Record record{};
    detail::check(torqued_next_record(client_.get(), timeout.count(), &record.record, &record.lost));
    return record;
  }

  /** The newest record, if one has arrived since the last call. */
  std::optional<Record> latest_record() {
    Record record{};
    detail::check(torqued_latest_record(client_.get(), &record.record, &record.lost));
    if (!record.record) return std::nullopt;
    return record;
  }

  void enable() const { detail::check(torqued_enable(client_.get())); }
  void disable() const { detail::check(torqued_disable(client_.get())); }
  void stop() const { detail::check(torqued_stop(client_.get())); }
  void acknowledge(std::uint32_t fault) const {
    detail::check(torqued_acknowledge(client_.get(), fault));
  }
  /** Uses that contact set from now on. */
  void choose_contact_set(const std::string& name) const {
    detail::check(torqued_choose_contact_set(client_.get(), name.c_str()));
  }
  /** Lets the automatic rule choose the contact set from now on. */
  void automatic_contact_set() const {
    detail::check(torqued_choose_contact_set(client_.get(), nullptr));
  }

  /** Sends a request and waits for its last answer; `progress(const TorquedAnswer&)` gets those before. */
  template <class Progress>
  TorquedAnswer request(const TorquedRequest& request, Progress&& progress) const {
    struct Context {
      std::remove_reference_t<Progress>& progress;
      detail::Thrown thrown;
    } context{progress, {}};
    auto call = [](void* pointer, const TorquedAnswer* answer) {
      auto& context = *static_cast<Context*>(pointer);
      context.thrown.keep([&] { return context.progress(*answer), true; });
    };
    TorquedAnswer answer{};
    auto code = torqued_request(client_.get(), &request, call, &context, &answer);
    context.thrown.rethrow();
    detail::check(code);
    return answer;
  }

  /** The handle of the C functions. */
  TorquedClient* handle() const noexcept { return client_.get(); }

 private:
  struct Close {
    void operator()(TorquedClient* client) const noexcept { torqued_disconnect(client); }
  };
  std::unique_ptr<TorquedClient, Close> client_;
};

/** Place on a trajectory. */
struct Progress {
  /** Time since its begin. */
  Seconds time;
  /** Time for which the robot can go on with what was sent. */
  Seconds buffered;
};

/** What the robot does while a program with a kept lease computes. */
enum class Meanwhile : std::uint32_t {
  /** It comes to rest within its limits, and holds. */
  hold = TORQUED_MEANWHILE_HOLD,
  /** Targets move on by their velocity and acceleration; torques and forces stay. */
  extrapolate = TORQUED_MEANWHILE_EXTRAPOLATE,
};

/** The right to command a robot, by lease: each reference renews it. Given back at its end: the robot holds. */
class Commander {
 public:
  explicit Commander(Client& client, std::uint32_t priority = 0) {
    TorquedCommander* commander = nullptr;
    detail::check(torqued_command(client.handle(), priority, &commander));
    commander_.reset(commander);
  }

  /** The reference that is sent next: change it, then send(). */
  TorquedReference& reference() { return *torqued_reference(commander_.get()); }

  /** Sends the reference; an error is about earlier ones. */
  void send() { detail::check(torqued_send(commander_.get())); }

  /** From now on a thread of the library keeps the lease while the program is busy for up to that time, at
   *  most 1 s: a program that is silent for longer loses it as any other. */
  void keep(Seconds busy, Meanwhile meanwhile) {
    const auto number = static_cast<std::uint32_t>(meanwhile);
    detail::check(torqued_keep(commander_.get(), busy.count(), number));
  }

  /** Asks for hold until a mode would be followed. */
  void hold_until_ready(Seconds timeout) {
    detail::check(torqued_hold_until_ready(commander_.get(), timeout.count()));
  }

  TorquedCommanderStatus status() {
    TorquedCommanderStatus status{};
    detail::check(torqued_status(commander_.get(), &status));
    return status;
  }

  /** Lets joints go: a hand can move them. To be called as send(). */
  void let_go(const std::vector<std::size_t>& joints) {
    detail::check(torqued_let_go(commander_.get(), joints.data(), joints.size()));
  }

  /** Prepares mode Cartesian with these frames. */
  void lead_frames(Client& client, const std::vector<std::size_t>& frames) {
    auto code = torqued_lead_frames(commander_.get(), client.handle(), frames.data(), frames.size());
    detail::check(code);
  }

  /** Goes to the reference's q_d and waits; `going(Seconds left)` returns false to end it. */
  template <class Going>
  bool go_to(Going&& going) {
    struct Context {
      std::remove_reference_t<Going>& going;
      detail::Thrown thrown;
    } context{going, {}};
    auto call = [](void* pointer, double left_s) {
      auto& context = *static_cast<Context*>(pointer);
      return context.thrown.keep([&] { return context.going(Seconds(left_s)); });
    };
    bool arrived = false;
    auto code = torqued_go_to(commander_.get(), call, &context, &arrived);
    context.thrown.rethrow();
    detail::check(code);
    return arrived;
  }
  bool go_to() {
    return go_to([](Seconds) { return true; });
  }

  /** Follows a trajectory; `at(double t, TorquedJointPoint* joints, std::size_t count)` computes it,
   *  `going(Progress)` returns false to end it. */
  template <class At, class Going>
  bool follow(Seconds duration, Seconds spacing, At&& at, Going&& going,
              TorquedMode mode = TORQUED_MODE_INVERSE_DYNAMICS) {
    struct Context {
      std::remove_reference_t<At>& at;
      std::remove_reference_t<Going>& going;
      detail::Thrown thrown;
    } context{at, going, {}};
    auto point = [](void* pointer, double t, TorquedJointPoint* joints, std::size_t count) {
      auto& context = *static_cast<Context*>(pointer);
      context.thrown.keep([&] { return context.at(t, joints, count), true; });
    };
    auto goes = [](void* pointer, double time_s, double buffered_s) {
      auto& context = *static_cast<Context*>(pointer);
      return context.thrown.keep(
          [&] { return context.going(Progress{Seconds(time_s), Seconds(buffered_s)}); });
    };
    bool arrived = false;
    auto code = torqued_follow(commander_.get(), mode, duration.count(), spacing.count(), point, goes,
                               &context, &arrived);
    context.thrown.rethrow();
    detail::check(code);
    return arrived;
  }
  template <class At>
  bool follow(Seconds duration, Seconds spacing, At&& at) {
    return follow(duration, spacing, std::forward<At>(at), [](Progress) { return true; });
  }

  /** Gives the lease back now, and reports an error of that; the commander cannot be used any more. */
  void close() { detail::check(torqued_give_back(commander_.release())); }

 private:
  struct Close {
    void operator()(TorquedCommander* commander) const noexcept { torqued_give_back(commander); }
  };
  std::unique_ptr<TorquedCommander, Close> commander_;
};

}  // namespace torqued

#endif
