#pragma once

#include <string>
#include <utility>
#include <vector>

#include "joint/judgement.h"
#include "joint/match_memory.h"
#include "joint/problem.h"

namespace gantry::internal {

/// What speaks against single scans: which, and in words that go on from its name.
using Objection = std::pair<size_t, std::string>;
using Objections = std::vector<Objection>;

/// One try at the whole problem, and what speaks against its outcome.
struct Attempt {
  std::string way;
  Poses poses;
  MatchMemory memory;
  double sigma_mm = 0;
  Evidence evidence;
  Wobble wobble;                      ///< Empty where something else speaks against the outcome already.
  std::string objection;              ///< Empty: believed, but for the scans that are left out.
  std::vector<std::string> left_out;  ///< By scan: why it takes no part; empty: it does.

  /// All connected, and none where others looked through; that they may still be free to move is another
  /// thing.
  bool in_place() const;
  size_t left_out_count() const;
  std::vector<bool> left_out_mask() const;
};

/// An attempt at these poses, not yet judged.
Attempt attempt_at(const JointProblem& problem, std::string way, Poses poses);

Pairs pairs_without(const std::vector<bool>& left_out, Pairs pairs);

/// From roughly right poses, as wrong as `start_mm`, to a judged result; scans that are left out stay where
/// they are.
void refine_and_judge(const JointProblem& problem, double start_mm, Attempt& attempt);

/// Of how many scans one may say that they are wrong and not the others: a quarter. More make the whole
/// doubtful.
size_t most_left_out(size_t scans);

/// The scans without which nothing would speak against those that stay: as few as a greedy choice finds.
Objections suspicious_scans(const JointProblem& problem, const Attempt& attempt);

/// Leaves the suspicious scans out, and adjusts and judges the others again, until nothing speaks against
/// them. False, and the attempt as it was, when they are too many, or the first scan is among them, to which
/// all poses refer.
bool leave_out_suspicious(const JointProblem& problem, Attempt& attempt);
/// The same for scans that more is known of.
bool leave_out(const JointProblem& problem, const Objections& objections, Attempt& attempt);

std::string names_of(const JointProblem& problem, const std::vector<size_t>& which);

/// For the worst wobble of an attempt that is to be believed.
double worst_wobble_mm(double sigma_mm);

}  // namespace gantry::internal
