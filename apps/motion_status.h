#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "cell_devices.h"

namespace gantry {

/// What `gantry-cell status` shows, as JSON (docs/files.md). Any thread.
nlohmann::json status_json(const Cell& cell, const CellDevices& devices, const std::string& command);

/// The same as a table for a terminal, made from the JSON of this process or of another.
std::string status_table(const nlohmann::json& status);

}  // namespace gantry
