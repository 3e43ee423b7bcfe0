#pragma once

#include <initializer_list>
#include <optional>
#include <utility>
#include <vector>

#include "gantry/foundation/clock.h"
#include "gantry/hal/drive.h"
#include "modbus/drive_profile.h"
#include "modbus/modbus_unit.h"
#include "modbus/start_watch.h"

namespace gantry {

/// One reading of a profile's status ranges.
class StatusImage {
 public:
  StatusImage(const DriveProfile& profile, std::vector<std::vector<uint16_t>> words)
      : profile_(&profile), words_(std::move(words)) {}

  bool has(const Register& word) const { return find(word) != nullptr; }
  /// Of a register within the ranges.
  double value(const Register& word) const;
  bool bit(const StatusBit& bit) const;
  bool bit(const std::optional<StatusBit>& bit) const { return bit && this->bit(*bit); }

 private:
  const uint16_t* find(const Register& word) const;

  const DriveProfile* profile_;
  std::vector<std::vector<uint16_t>> words_;  ///< By range.
};

/// What all kinds of Modbus drives share: a profile, a unit on a bus, status by ranges, and the watch over
/// the last start. The kinds (kinds/) add what they do to start, stop, power and reset.
class RegisterDrive : public Drive {
 public:
  struct Options {
    double counts_per_axis_unit = 0;
    double in_position = 0;  ///< Axis units.
  };

  RegisterDrive(DriveProfile profile, ModbusUnit unit, const Options& options, Clock& clock);

  const DriveInfo& info() const override { return unit_.info(); }
  Result<void> connect() override;
  Result<void> set_communication_timeout(double timeout_s) override;

 protected:
  /// Idempotent: the same value once more changes nothing.
  static constexpr WriteHandling kSetting{.urgent = false, .repeatable = true};
  static constexpr WriteHandling kStop{.urgent = true, .repeatable = true};

  using Values = std::initializer_list<std::pair<const char*, double>>;

  Result<StatusImage> read_image() const;
  /// Of any register: from the image where it lies in it, else with a read of its own.
  Result<double> value(const StatusImage& image, const Register& word) const;
  Result<void> write(const Register& word, double value, WriteHandling handling = {}) const;
  /// The registers of a profile's block in their order, or kLimit where a value does not fit.
  Result<std::vector<uint16_t>> encode(Values values) const;

  /// Position, limits, emergency stop and following error.
  void fill_common(DriveStatus& status, const StatusImage& image) const;
  /// The register value of a speed or an acceleration: the nearest, at least 1; nothing for what is not
  /// positive or beyond `maximum`.
  static std::optional<double> rate(double value, double maximum);
  tl::unexpected<Fault> does_not_fit() const;
  double to_counts(double position) const { return std::round(position * counts_per_axis_unit_); }
  bool at_target(const StatusImage& image) const;
  void forget_motion();

  const DriveProfile profile_;
  const ModbusUnit unit_;
  const double counts_per_axis_unit_;
  const double in_position_counts_;  ///< At least 1.
  Clock& clock_;
  std::optional<double> target_counts_;  ///< Of the last move, unless something ended it early.
  StartWatch start_;
};

}  // namespace gantry
