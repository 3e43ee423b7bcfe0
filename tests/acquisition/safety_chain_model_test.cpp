// The safety chain against the oracle, which says the same in another way: every short sequence of a small
// alphabet, and long random ones of everything that can be read.

#include <gtest/gtest.h>

#include <random>

#include "acquisition/safety_oracle.h"

namespace gantry {
namespace {

using testing::SafetyOracle;
using testing::SafetyStep;

std::string text(const std::vector<SafetyStep>& steps) {
  std::string result;
  for (const SafetyStep& step : steps) {
    result += "\n  now " + std::to_string(step.now_s) + " sampled " +
              std::to_string(step.snapshot.sampled_at_s) + (step.snapshot.valid ? " " : " invalid ");
    for (size_t k = 0; k < step.snapshot.count; ++k) result += step.snapshot.closed[k] ? '1' : '0';
    if (step.reset) result += " reset";
  }
  return result;
}

/// Runs both over the steps; false (with a failure) at the first difference.
bool agree(const SafetySettings& settings, const std::vector<SafetyStep>& steps) {
  SafetyChain chain(settings);
  SafetyOracle oracle(settings);
  for (const SafetyStep& step : steps) {
    const SafetyVerdict verdict = chain.update(step.snapshot, step.reset, step.now_s);
    const SafetyOracle::Answer answer = oracle.after(step);
    bool cause_fits = true;
    switch (verdict.cause) {
      case SafetyCause::kNone:
        cause_fits = verdict.stop == StopCategory::kNone;
        break;
      case SafetyCause::kNoData:
        cause_fits = !answer.fresh && verdict.input == -1;
        break;
      case SafetyCause::kDiscrepancy:
        cause_fits = answer.fresh && answer.faulty.at(static_cast<size_t>(verdict.input));
        break;
      case SafetyCause::kTripped:
        cause_fits = answer.fresh && !answer.released.at(static_cast<size_t>(verdict.input)) &&
                     std::none_of(answer.faulty.begin(), answer.faulty.end(), [](bool f) { return f; });
        break;
      case SafetyCause::kStopping:
        cause_fits = verdict.stop == StopCategory::kCategory1;
        break;
      case SafetyCause::kResetNeeded:
        cause_fits = verdict.stop == StopCategory::kCategory0;
        break;
      case SafetyCause::kStart:
        cause_fits = false;
        break;
    }
    const bool same = verdict.stop == answer.stop && verdict.reset == answer.reset &&
                      verdict.motion_allowed == (answer.stop == StopCategory::kNone) && cause_fits;
    if (!same) {
      ADD_FAILURE() << "stop " << static_cast<int>(verdict.stop) << " expected "
                    << static_cast<int>(answer.stop) << ", reset " << static_cast<int>(verdict.reset)
                    << " expected " << static_cast<int>(answer.reset) << ", cause "
                    << static_cast<int>(verdict.cause) << " at time " << step.now_s << " of" << text(steps);
      return false;
    }
  }
  return true;
}

SafetySettings one_input(std::vector<int> channels, StopCategory stop, double release_s) {
  SafetySettings settings;
  settings.inputs = {{"stop", std::move(channels), stop, 0.15, release_s}};
  settings.max_age_s = 0.1;
  settings.ramp_limit_s = 0.25;
  return settings;
}

/// Cycle of 0.1 s; letters: two levels, or nothing new (stale), with and without a reset request.
SafetyStep step_of(int letter, int cycle, size_t channels) {
  SafetyStep step;
  step.now_s = 0.1 * cycle;
  step.reset = letter % 2 == 1;
  const int levels = letter / 2;
  step.snapshot.count = channels;
  step.snapshot.valid = levels < 4;
  step.snapshot.sampled_at_s = step.now_s;
  step.snapshot.closed[0] = levels & 1;
  if (channels == 2) step.snapshot.closed[1] = levels & 2;
  return step;
}

/// Every sequence of `length` cycles after a start in which the chain is closed and reset, or from the very
/// start.
void check_all_sequences(const SafetySettings& settings, int length, bool from_running) {
  const size_t channels = settings.channel_count();
  const std::vector<int> letters = channels == 2 ? std::vector<int>{0, 1, 2, 3, 4, 6, 7, 8}
                                                 // not every reset
                                                 : std::vector<int>{0, 1, 2, 3, 8, 9};
  size_t count = 1;
  for (int k = 0; k < length; ++k) count *= letters.size();
  for (size_t sequence = 0; sequence < count; ++sequence) {
    std::vector<SafetyStep> steps;
    if (from_running)
      for (const int letter : {6, 6, 6, 7})
        steps.push_back(step_of(letter, static_cast<int>(steps.size()), channels));
    size_t rest = sequence;
    for (int k = 0; k < length; ++k, rest /= letters.size())
      steps.push_back(step_of(letters[rest % letters.size()], static_cast<int>(steps.size()), channels));
    if (!agree(settings, steps)) return;
  }
}

TEST(SafetyChainModel, EverySequenceOfTwoChannelsFromTheStart) {
  check_all_sequences(one_input({0, 1}, StopCategory::kCategory1, 0.1), 5, false);
}

TEST(SafetyChainModel, EverySequenceOfTwoChannelsFromRunning) {
  check_all_sequences(one_input({0, 1}, StopCategory::kCategory1, 0), 5, true);
}

TEST(SafetyChainModel, EverySequenceOfOneChannel) {
  check_all_sequences(one_input({3}, StopCategory::kCategory0, 0.1), 6, false);
  check_all_sequences(one_input({3}, StopCategory::kCategory1, 0.1), 6, true);
}

TEST(SafetyChainModel, LongRandomSequencesOfThreeInputs) {
  size_t moving = 0, ramping = 0, refused = 0, cycles = 0;
  for (uint64_t seed = 0; seed < 400; ++seed) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> uniform;
    const auto chance = [&](double p) { return uniform(random) < p; };
    SafetySettings settings;
    settings.inputs = {{"emergency stop", {0, 1}, StopCategory::kCategory0, 0.05, 0.02},
                       {"door", {2, 3}, StopCategory::kCategory1, 0.2, 0.0},
                       {"curtain", {4}, StopCategory::kCategory1, 0.0, 0.03}};
    settings.max_age_s = 0.06;
    settings.ramp_limit_s = 0.3;
    std::vector<SafetyStep> steps;
    SafetyStep step;
    step.snapshot.count = 5;
    step.snapshot.closed.fill(true);
    double now_s = uniform(random);
    const double trouble = chance(0.5) ? 0.01 : 0.1;
    for (int k = 0; k < 150; ++k) {
      now_s += chance(0.02) ? 0.1 : 0.01;
      step.now_s = now_s;
      if (chance(0.7)) {  // a new reading
        step.snapshot.valid = true;
        step.snapshot.sampled_at_s =
            now_s - 0.01 * uniform(random) + (chance(0.02) ? -0.05 + 0.2 * uniform(random) : 0);
        for (size_t c = 0; c < 5; ++c)
          if (chance(step.snapshot.closed[c] ? trouble : 0.3))
            step.snapshot.closed[c] = !step.snapshot.closed[c];
      }
      step.snapshot.count = chance(0.005) ? 4 : 5;
      if (chance(0.4)) step.reset = !step.reset;
      steps.push_back(step);
    }
    ASSERT_TRUE(agree(settings, steps)) << "seed " << seed;
    SafetyChain chain(settings);
    for (const SafetyStep& each : steps) {
      const SafetyVerdict verdict = chain.update(each.snapshot, each.reset, each.now_s);
      ++cycles;
      moving += verdict.motion_allowed;
      ramping += verdict.stop == StopCategory::kCategory1;
      refused += verdict.reset == SafetyReset::kRefused;
    }
  }
  // The sequences do get somewhere.
  EXPECT_GT(moving, cycles / 20);
  EXPECT_GT(ramping, cycles / 50);
  EXPECT_GT(refused, 100u);
}

}  // namespace
}  // namespace gantry
