#pragma once

#include <cstdint>
#include <optional>

#include "gantry/sim/stage.h"
#include "twin_drive.h"

namespace gantry {

/// IAI ROBO Cylinder: PCON/ACON/SCON controller, numerical movement commands over Modbus.
///
/// | addresses | what | manual (ROBO Cylinder, Modbus) |
/// |---|---|---|
/// | 0100-012F | status bits, the same as DSS1, DSS2, DSSE | 4.3.4 |
/// | 0403 SON, 0407 RES, 040A STP, 040B HOME | control coils (0400-040F are bits 15-0 of 0D00)
/// | 5.4.1, 5.4.4, 5.4.6, 5.4.7 | | 0427 PMSL, 042C STOP | Modbus enabled; deceleration stop | 5.4.16, 5.4.17
/// | | 0D00, 0D03 | control word; move to stored position | 5.5 | | 9000 PNOW, 9002 ALMC, 9005 DSS1, 9007
/// DSSE, 9008 STAT, 900A VNOW | monitors | 4.3.2, 5.3 | | 9900 PCMD, 9902 INP, 9904 VCMD, 9906 ACMD, 9907
/// PPOW, 9908 CTLF | numerical movement | 5.6.1 |
///
/// Not checked against a manual: alarm codes 080, 083, 0A2, 0A3, that an alarm drops the servo-on command,
/// and that 9900-9908 can be read back.
class IaiRoboCylinder final : public TwinDrive {
 public:
  explicit IaiRoboCylinder(SimulatedStage& stage);

  bool serves(int function) const override;
  ModbusAnswer<std::vector<uint16_t>> read_registers(int address, int count, double now_s) override;
  ModbusAnswer<std::vector<uint8_t>> read_bits(int address, int count, double now_s) override;
  ModbusAnswer<void> write_bit(int address, bool on, double now_s) override;
  ModbusAnswer<void> write_registers(int address, std::span<const uint16_t> words, double now_s) override;

  void raise_alarm(int code, bool persists, double now_s) override;
  void clear_alarm_cause() override { alarm_persists_ = false; }
  void set_emergency_stop(bool active, double now_s) override;

 private:
  enum class Travel { kNone, kMove, kHome };
  /// Registers 9900 to 9908.
  struct NumericalMove {
    int32_t target = 0;         ///< 0.01 mm.
    int32_t band = 10;          ///< 0.01 mm.
    int32_t speed = 0;          ///< 0.01 mm/s.
    uint16_t acceleration = 0;  ///< 0.01 G.
    uint16_t push_percent = 0;
    uint16_t flags = 0;
  };

  uint16_t device_status(const StageState& state) const;    ///< DSS1, 9005.
  uint16_t extended_status(const StageState& state) const;  ///< DSSE, 9007.
  int32_t system_status(const StageState& state) const;     ///< STAT, 9008.
  uint16_t monitor(int address, const StageState& state) const;
  std::optional<uint16_t> numerical_register(int address) const;
  ModbusAnswer<void> write_numerical(int address, std::span<const uint16_t> words, double now_s);

  void apply_control(uint16_t word, double now_s);
  void reset_alarm();
  void power_off(double now_s);
  void stop_travel(double now_s);
  void start_numerical_move(double now_s);
  void run(Travel travel, double now_s);
  int32_t position_counts(const StageState& state) const;

  SimulatedStage& stage_;
  uint16_t control_ = 0;  ///< Coils 0400 (bit 15) to 040F (bit 0).
  bool modbus_enabled_ = false;
  NumericalMove command_;
  std::optional<int32_t> target_;         ///< What the servo holds or travels to, in counts.
  Travel travel_ = Travel::kNone;         ///< What was last started.
  Travel paused_travel_ = Travel::kNone;  ///< What resumes when the pause ends.
  int alarm_ = 0;
  bool alarm_persists_ = false;
  bool emergency_stop_ = false;
};

}  // namespace gantry
