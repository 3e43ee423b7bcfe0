// Plays random faults against the real controller in a simulated cell, faster than real time, and holds what
// the stages truly did against the rules of docs/faults.md.

#include <spdlog/spdlog.h>

#include <chrono>
#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>

#include "app.h"
#include "campaign.h"

namespace {

using namespace gantry;

struct Command {
  CampaignOptions options;
  std::filesystem::path cell = "examples/cells/simulated.yaml";
  std::filesystem::path out = ".";
  std::filesystem::path replay;
  bool json = false;
};

std::string described(const Violation& violation) {
  char time[40];
  std::snprintf(time, sizeof time, "%.2f s", violation.at_s);
  return violation.invariant + " broken at " + time + ": " + violation.detail;
}

nlohmann::json to_json(const Violation& violation) {
  return {{"invariant", violation.invariant}, {"at_s", violation.at_s}, {"detail", violation.detail}};
}

std::filesystem::path write_failure(const Command& command, const FaultTargetNames& names,
                                    const CampaignFailure& failure) {
  std::filesystem::create_directories(command.out);
  const auto path =
      command.out / ("faults-" + std::to_string(command.options.seed) + "-" + std::to_string(failure.index) +
                     "-" + failure.violation.invariant + ".yaml");
  std::ofstream file(path);
  file << fault_schedule_text(failure.shrunk, names,
                              described(failure.violation) + "\nSchedule " + std::to_string(failure.index) +
                                  " of campaign " + std::to_string(command.options.seed) +
                                  ", shrunk. Play it again: gantry-campaign --replay " +
                                  path.filename().string());
  if (!file.flush()) throw InputError(path.string() + ": cannot be written");
  return path;
}

ExitCode replay(const Command& command, const CampaignCell& setup) {
  const FaultSchedule schedule = read_fault_schedule(command.replay, fault_targets(setup.cell));
  const PlayResult played = play(setup, schedule);
  if (command.json) {
    nlohmann::json json = {{"held", !played.violation},
                           {"simulated_s", played.simulated_s},
                           {"attempts", played.attempts},
                           {"scans", played.scans},
                           {"scans_after_slip", played.slipped_scans}};
    for (size_t k = 0; k < schedule.entries.size(); ++k)
      json["faults"].push_back({{"fault", schedule.entries[k].text()},
                                {"played", played.faults[k].played},
                                {"reaction", played.faults[k].reaction}});
    if (played.violation) json["violation"] = to_json(*played.violation);
    std::printf("%s\n", json.dump(2).c_str());
  } else {
    for (const std::string& line : played.story) std::printf("%s\n", line.c_str());
    std::printf("%d scans in %.1f simulated s, %d attempts: %s\n", played.scans, played.simulated_s,
                played.attempts,
                played.violation ? described(*played.violation).c_str() : "every invariant held");
  }
  return played.violation ? ExitCode::kFail : ExitCode::kPass;
}

void print(const CampaignResult& result, double wall_s) {
  std::printf("%-24s %7s  how the controller reacted\n", "fault", "played");
  for (const auto& [kind, counted] : result.kinds) {
    std::string reactions;
    for (const auto& [reaction, times] : counted.reactions)
      reactions += (reactions.empty() ? "" : ", ") + reaction + " " + std::to_string(times);
    std::printf("%-24s %7d  %s\n", kind.c_str(), counted.played, reactions.c_str());
  }
  std::printf(
      "%llu schedules, %.2f simulated hours in %.1f s, %llu attempts, %llu scans (%llu of them after an "
      "encoder had slipped)\n",
      static_cast<unsigned long long>(result.schedules), result.simulated_s / 3600, wall_s,
      static_cast<unsigned long long>(result.attempts), static_cast<unsigned long long>(result.scans),
      static_cast<unsigned long long>(result.slipped_scans));
}

nlohmann::json to_json(const CampaignResult& result) {
  nlohmann::json json = {{"schedules", result.schedules},
                         {"simulated_h", result.simulated_s / 3600},
                         {"attempts", result.attempts},
                         {"scans", result.scans},
                         {"scans_after_slip", result.slipped_scans},
                         {"failed", result.failed}};
  for (const auto& [kind, counted] : result.kinds)
    json["faults"][kind] = {{"played", counted.played}, {"reactions", counted.reactions}};
  json["failures"] = nlohmann::json::array();
  return json;
}

ExitCode campaign(const Command& command, const CampaignCell& setup) {
  const auto begin = std::chrono::steady_clock::now();
  const CampaignResult result = run_campaign(setup, command.options);
  const double wall_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  const FaultTargetNames names = fault_targets(setup.cell);
  nlohmann::json json = to_json(result);
  if (!command.json) print(result, wall_s);
  for (const CampaignFailure& failure : result.failures) {
    const auto path = write_failure(command, names, failure);
    nlohmann::json entry = to_json(failure.violation);
    entry["schedule"] = failure.index;
    entry["file"] = path.string();
    json["failures"].push_back(entry);
    if (!command.json)
      std::printf("schedule %llu: %s\n  %zu faults left after shrinking: %s\n",
                  static_cast<unsigned long long>(failure.index), described(failure.violation).c_str(),
                  failure.shrunk.entries.size(), path.c_str());
  }
  if (command.json)
    std::printf("%s\n", json.dump(2).c_str());
  else if (result.failed == 0)
    std::printf("every invariant held\n");
  else
    std::printf("%llu schedules broke an invariant\n", static_cast<unsigned long long>(result.failed));
  return result.failed == 0 ? ExitCode::kPass : ExitCode::kFail;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "Plays random fault schedules against runs in a simulated cell, on a virtual clock, and checks what "
      "must\n"
      "hold whatever happens. A schedule that breaks an invariant is shrunk and written as a file that "
      "replays it.\n"
      "Example: gantry-campaign --schedules 1000 --seed 1 --out failures\n"
      "         gantry-campaign --replay failures/faults-1-17-stops.yaml",
      "gantry-campaign"};
  CommonOptions common;
  add_common_options(app, common);
  Command command;
  app.add_option("--schedules", command.options.schedules, "How many schedules to play")
      ->check(CLI::Range(1, 100000000))
      ->capture_default_str();
  app.add_option("--hours", command.options.hours, "Play for so many simulated hours instead")
      ->check(number_within(0.001, 1e6));
  app.add_option("--seed", command.options.seed, "The same seed plays the same schedules")
      ->capture_default_str();
  app.add_option("--cell", command.cell,
                 "CELL.yaml with a simulation section; all its drives are simulated here")
      ->capture_default_str();
  app.add_option("--out", command.out, "Folder for the files of schedules that failed")
      ->capture_default_str();
  app.add_option("--replay", command.replay, "Play this FAULTS.yaml instead, with its own seed");
  app.add_flag("--json", command.json, "Print the result as JSON");
  return run_app(app, argc, argv, common, [&] {
    require_writable_folder("--out", command.out);
    const CampaignCell setup = read_campaign_cell(command.cell);
    return command.replay.empty() ? campaign(command, setup) : replay(command, setup);
  });
}
