#include "motion_status.h"

#include <unistd.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <numbers>

namespace gantry {
namespace {

template <typename... Values>
void append(std::string& text, const char* format, Values... values) {
  char line[400];
  std::snprintf(line, sizeof line, format, values...);
  text += line;
}

nlohmann::json axis_json(const Axis& axis, const AxisStatus& status, const AxisFigures& figures,
                         double now_s) {
  const DriveStatus& drive = status.drive;
  const bool rotary = axis.kind() == AxisKind::kRotary;
  const double scale = rotary ? 180 / std::numbers::pi : 1;
  nlohmann::json json;
  json["axis"] = axis.name();
  json["state"] = to_string(status.state);
  json["unit"] = rotary ? "deg" : "mm";
  json["position"] = figures.drive.read ? nlohmann::json(drive.position * scale) : nlohmann::json();
  json["target"] = status.target * scale;
  json["following_error"] =
      drive.following_error ? nlohmann::json(*drive.following_error * scale) : nlohmann::json();
  json["servo_on"] = drive.servo_on;
  json["homed"] = drive.homed;
  json["moving"] = drive.moving;
  json["lower_limit"] = drive.lower_limit;
  json["upper_limit"] = drive.upper_limit;
  json["emergency_stop"] = drive.emergency_stop;
  json["alarm"] = drive.alarm ? nlohmann::json(*drive.alarm) : nlohmann::json();
  json["error"] = status.error;
  json["reading_age_s"] = figures.drive.read ? nlohmann::json(figures.drive.age_s(now_s)) : nlohmann::json();
  json["faults"] = figures.drive.faults;
  json["drive"] = axis.info().text();
  return json;
}

nlohmann::json loop_json(const Motion& motion, double period_s) {
  const auto loop = motion.loop_statistics();
  const auto grant = motion.real_time_grant();
  if (!loop || !grant) return nullptr;
  return {{"period_ms", period_s * 1e3},
          {"cycles", loop->cycles},
          {"missed", loop->missed},
          {"late_us", {{"p50", loop->late_p50_us}, {"p99", loop->late_p99_us}, {"max", loop->late_max_us}}},
          {"busy_us", {{"p50", loop->busy_p50_us}, {"p99", loop->busy_p99_us}, {"max", loop->busy_max_us}}},
          {"sched_fifo", grant->fifo},
          {"memory_locked", grant->memory_locked},
          {"note", grant->note}};
}

nlohmann::json bus_json(const ModbusBus& bus) {
  const BusStatistics s = modbus_bus_statistics(bus);
  return {{"bus", modbus_bus_address(bus)},
          {"requests", s.requests},
          {"retries", s.retries},
          {"timeouts", s.timeouts},
          {"wrong_answers", s.wrong_answers},
          {"exceptions", s.exceptions},
          {"unreachable", s.unreachable},
          {"reconnects", s.reconnects},
          {"strays", s.strays},
          {"last_error", s.last_error},
          {"round_trip_us",
           {{"min", s.round_trip_min_us},
            {"p50", s.round_trip_median_us},
            {"p99", s.round_trip_p99_us},
            {"max", s.round_trip_max_us}}}};
}

/// "bus 127.0.0.1:1502: 812 requests, 31 us (median), 90 (p99), 240 (max); 2 retries, ...".
std::string bus_line(const nlohmann::json& bus) {
  const nlohmann::json& trip = bus.at("round_trip_us");
  std::string text;
  append(text, "  bus %s: %lld requests, round trip %.0f us (median), %.0f (p99), %.0f (max)",
         bus.at("bus").get<std::string>().c_str(), bus.at("requests").get<long long>(),
         trip.at("p50").get<double>(), trip.at("p99").get<double>(), trip.at("max").get<double>());
  const char* separator = "; ";
  for (const auto& [key, words] : {std::pair{"retries", "repeated"},
                                   {"timeouts", "timed out"},
                                   {"wrong_answers", "answered wrongly"},
                                   {"exceptions", "exceptions"},
                                   {"unreachable", "unreachable"},
                                   {"reconnects", "reconnected"},
                                   {"strays", "late answers thrown away"}}) {
    const auto count = bus.at(key).get<long long>();
    if (count == 0) continue;
    append(text, "%s%lld %s", separator, count, words);
    separator = ", ";
  }
  const std::string last = bus.at("last_error");
  return text + (last.empty() ? "" : "; last: " + last) + "\n";
}

std::string safety_words(const SafetyPermit& permit) {
  const SafetyVerdict now = permit.verdict();
  if (now.cause == SafetyCause::kResetNeeded && now.latched_by == SafetyCause::kStart)
    return "all inputs are closed; home, jog, run or reset is its reset";
  return now.motion_allowed ? "closed" : permit.why();
}

const char* stop_words(StopCategory stop) {
  return stop == StopCategory::kNone        ? "none"
         : stop == StopCategory::kCategory0 ? "category 0"
                                            : "category 1";
}

std::string flags_of(const nlohmann::json& axis) {
  std::string text;
  const auto add = [&text](const std::string& word) { text += (text.empty() ? "" : ", ") + word; };
  if (axis.at("emergency_stop").get<bool>()) add("E-STOP");
  if (!axis.at("alarm").is_null()) {
    char code[32];
    std::snprintf(code, sizeof code, "alarm %02Xh", static_cast<unsigned>(axis.at("alarm").get<int>()));
    add(code);
  }
  if (axis.at("lower_limit").get<bool>()) add("lower limit");
  if (axis.at("upper_limit").get<bool>()) add("upper limit");
  return text.empty() ? "-" : text;
}

}  // namespace

nlohmann::json status_json(const Cell& cell, const CellDevices& devices, const std::string& command) {
  const Motion& motion = *devices.motion;
  const SupervisorStatus figures = motion.figures();
  const std::vector<AxisStatus> statuses = motion.statuses();
  nlohmann::json json;
  json["cell"] = cell.name;
  json["command"] = command;
  json["process"] = ::getpid();
  json["written_at_s"] =
      std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
  json["axes"] = nlohmann::json::array();
  for (size_t i = 0; i < statuses.size(); ++i)
    json["axes"].push_back(axis_json(*motion.axes()[i], statuses[i], figures.axes[i], figures.now_s));
  json["required_stop"] = stop_words(figures.stop);
  json["safety"] =
      devices.safety.permit ? nlohmann::json(safety_words(*devices.safety.permit)) : nlohmann::json();
  json["loop"] = loop_json(motion, cell.supervisor.period_s);
  json["buses"] = nlohmann::json::array();
  for (const auto& bus : devices.buses) json["buses"].push_back(bus_json(*bus));
  json["remarks"] = motion.remarks();
  return json;
}

std::string status_table(const nlohmann::json& status) {
  std::string text;
  append(text, "  %-10s %-15s %14s %14s  %-5s  %-5s  %-6s  %s\n", "axis", "state", "position", "target",
         "servo", "homed", "moving", "alarms and limits");
  for (const nlohmann::json& axis : status.at("axes")) {
    const std::string unit = axis.at("unit");
    const bool homed = axis.at("homed").get<bool>();
    const auto value = [&](const nlohmann::json& number) {
      if (!homed || number.is_null()) return std::string("unknown");
      char figure[40];
      std::snprintf(figure, sizeof figure, "%.3f %s", number.get<double>(), unit.c_str());
      return std::string(figure);
    };
    append(text, "  %-10s %-15s %14s %14s  %-5s  %-5s  %-6s  %s\n",
           axis.at("axis").get<std::string>().c_str(), axis.at("state").get<std::string>().c_str(),
           value(axis.at("position")).c_str(), value(axis.at("target")).c_str(),
           axis.at("servo_on").get<bool>() ? "on" : "off", homed ? "yes" : "no",
           axis.at("moving").get<bool>() ? "yes" : "no", flags_of(axis).c_str());
  }
  for (const nlohmann::json& axis : status.at("axes")) {
    const std::string error = axis.at("error");
    if (!error.empty()) text += "  " + axis.at("drive").get<std::string>() + ": " + error + "\n";
  }
  if (!status.at("safety").is_null())
    text += "  safety chain: " + status.at("safety").get<std::string>() + "\n";
  const nlohmann::json& loop = status.at("loop");
  if (!loop.is_null()) {
    const nlohmann::json &late = loop.at("late_us"), &busy = loop.at("busy_us");
    append(text,
           "  loop: %.0f ms, %llu cycles, %llu missed; late by %.0f us (median), %.0f (p99), %.0f (max); "
           "busy %.0f, %.0f, %.0f us\n",
           loop.at("period_ms").get<double>(), loop.at("cycles").get<unsigned long long>(),
           loop.at("missed").get<unsigned long long>(), late.at("p50").get<double>(),
           late.at("p99").get<double>(), late.at("max").get<double>(), busy.at("p50").get<double>(),
           busy.at("p99").get<double>(), busy.at("max").get<double>());
    append(text, "  real time: %s, memory %s%s%s\n",
           loop.at("sched_fifo").get<bool>() ? "SCHED_FIFO" : "ordinary",
           loop.at("memory_locked").get<bool>() ? "locked" : "not locked",
           loop.at("note").get<std::string>().empty() ? "" : "; ",
           loop.at("note").get<std::string>().c_str());
  }
  for (const nlohmann::json& bus : status.at("buses")) text += bus_line(bus);
  for (const nlohmann::json& remark : status.at("remarks")) text += "  " + remark.get<std::string>() + "\n";
  return text;
}

}  // namespace gantry
