// What may arrive on a serial line in answer to a request. The first byte of an input chooses the request.

#include "fuzz.h"
#include "modbus/rtu_frame.h"

namespace gantry::fuzz {
namespace {

using modbus_pdu::Request;

std::vector<Request> requests() {
  const uint16_t words[] = {1, 2};
  return {modbus_pdu::read_registers(modbus_pdu::kReadRegisters, 0x9000, 10),
          modbus_pdu::read_bits(modbus_pdu::kReadDiscreteInputs, 3, 11),
          modbus_pdu::write_coil(0x0403, true),
          modbus_pdu::write_register(0x3100, 15),
          modbus_pdu::write_registers(0x6200, words),
          modbus_pdu::echo(0x1234)};
}

}  // namespace

std::vector<std::string> seeds() {
  std::vector<std::string> all;
  char index = 0;
  for (const Request& request : requests()) {
    modbus_pdu::Bytes pdu = request.answer_begin;
    pdu.resize(request.answer_size, 7);
    const modbus_pdu::Bytes frame = rtu_frame(1, pdu);
    all.push_back(std::string(1, index++) + std::string(frame.begin(), frame.end()));
  }
  return all;
}

}  // namespace gantry::fuzz

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace gantry;
  static const auto requests = fuzz::requests();
  if (size == 0) return 0;
  const auto& request = requests[data[0] % requests.size()];
  // In memory of its own, so that a byte read behind its end shows.
  const std::vector<uint8_t> received(data + 1, data + size);
  const RtuAnswer first = first_rtu_answer(received);
  if (first.state != RtuAnswer::State::kComplete) return 0;
  if (first.length < 5 || first.length > received.size()) throw std::logic_error("no such frame");
  const auto answer = modbus_pdu::check_answer(request, std::span(received).subspan(1, first.length - 3));
  if (!answer || (answer->front() & modbus_pdu::kExceptionFlag)) return 0;
  if (request.pdu[0] == modbus_pdu::kReadRegisters && modbus_pdu::registers_of(*answer).size() != 10)
    throw std::logic_error("another number of registers than was asked for");
  if (request.pdu[0] == modbus_pdu::kReadDiscreteInputs && modbus_pdu::bits_of(*answer, 11).size() != 11)
    throw std::logic_error("another number of bits than was asked for");
  return 0;
}
