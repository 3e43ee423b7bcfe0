#include "modbus/register_drive.h"

#include <algorithm>
#include <cmath>

namespace gantry {

const uint16_t* StatusImage::find(const Register& word) const {
  for (size_t i = 0; i < words_.size(); ++i) {
    const RegisterRange& range = profile_->status[i];
    if (word.address >= range.first &&
        word.address + words_of(word.type) <= range.first + size_t{range.count})
      return words_[i].data() + (word.address - range.first);
  }
  return nullptr;
}

double StatusImage::value(const Register& word) const {
  return value_from_words({find(word), words_of(word.type)}, word.type, profile_->word_order);
}

bool StatusImage::bit(const StatusBit& bit) const {
  const auto bits = static_cast<uint32_t>(static_cast<int64_t>(value(bit.word)));
  return ((bits >> bit.bit & 1) != 0) != bit.active_low;
}

RegisterDrive::RegisterDrive(DriveProfile profile, ModbusUnit unit, const Options& options, Clock& clock)
    : profile_(std::move(profile)),
      unit_(std::move(unit)),
      counts_per_axis_unit_(options.counts_per_axis_unit),
      in_position_counts_(std::max(1.0, std::round(options.in_position * options.counts_per_axis_unit))),
      clock_(clock) {}

void RegisterDrive::forget_motion() {
  target_counts_.reset();
  start_.forget();
}

Result<void> RegisterDrive::connect() {
  for (const RegisterRange& range : profile_.status) {
    if (auto words = unit_.first_read(range.first, range.count); !words)
      return tl::make_unexpected(words.error());
  }
  return {};
}

Result<StatusImage> RegisterDrive::read_image() const {
  std::vector<std::vector<uint16_t>> image;
  for (const RegisterRange& range : profile_.status) {
    auto words = unit_.read(range.first, range.count);
    if (!words) return tl::make_unexpected(words.error());
    image.push_back(std::move(*words));
  }
  return StatusImage(profile_, std::move(image));
}

Result<double> RegisterDrive::value(const StatusImage& image, const Register& word) const {
  if (image.has(word)) return image.value(word);
  const auto words = unit_.read(word.address, static_cast<uint16_t>(words_of(word.type)));
  if (!words) return tl::make_unexpected(words.error());
  return value_from_words(*words, word.type, profile_.word_order);
}

Result<void> RegisterDrive::write(const Register& word, double value, WriteHandling handling) const {
  std::vector<uint16_t> words;
  if (!append_value(words, value, word.type, profile_.word_order)) return does_not_fit();
  if (words.size() == 1) return unit_.write_one(word.address, words[0], handling);
  return unit_.write(word.address, words, handling);
}

Result<std::vector<uint16_t>> RegisterDrive::encode(Values values) const {
  std::vector<uint16_t> words;
  for (const auto& [name, value] : values)
    if (!append_value(words, value, profile_.reg(name).type, profile_.word_order)) return does_not_fit();
  return words;
}

Result<void> RegisterDrive::set_communication_timeout(double timeout_s) {
  const auto word = profile_.find_register("communication_timeout");
  if (!word) return Drive::set_communication_timeout(timeout_s);
  const double counts = std::ceil(timeout_s / profile_.number("communication_timeout_unit_s") - 1e-9);
  if (!(timeout_s >= 0)) return unit_.refused("a communication time-out cannot be negative");
  std::vector<uint16_t> words;
  if (!append_value(words, counts, word->type, profile_.word_order))
    return unit_.refused("a communication time-out of " + std::to_string(timeout_s) +
                         " s does not fit into the drive's register");
  return words.size() == 1 ? unit_.write_one(word->address, words[0], kSetting)
                           : unit_.write(word->address, words, kSetting);
}

void RegisterDrive::fill_common(DriveStatus& status, const StatusImage& image) const {
  const double position = image.value(profile_.reg("position"));
  status.position = position / counts_per_axis_unit_;
  if (const auto command = profile_.find_register("command_position"))
    status.following_error = (image.value(*command) - position) / counts_per_axis_unit_;
  if (const auto error = profile_.find_register("following_error"))
    status.following_error = image.value(*error) / counts_per_axis_unit_;
  status.emergency_stop = image.bit(profile_.find_bit("emergency_stop"));
  status.lower_limit = image.bit(profile_.find_bit("lower_limit"));
  status.upper_limit = image.bit(profile_.find_bit("upper_limit"));
}

std::optional<double> RegisterDrive::rate(double value, double maximum) {
  if (!(value > 0) || !(std::round(value) <= maximum)) return std::nullopt;
  return std::max(1.0, std::round(value));
}

tl::unexpected<Fault> RegisterDrive::does_not_fit() const {
  return fault(FaultKind::kLimit, info().text(),
               "move refused: target, speed or acceleration does not fit into the drive's registers");
}

bool RegisterDrive::at_target(const StatusImage& image) const {
  return target_counts_ &&
         std::abs(image.value(profile_.reg("position")) - *target_counts_) <= in_position_counts_;
}

}  // namespace gantry
