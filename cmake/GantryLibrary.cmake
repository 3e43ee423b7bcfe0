# gantry_library(NAME SOURCES... ) makes the static library gantry_NAME of one folder of the house.
# Public headers live in NAME/include/gantry/NAME, everything else beside the sources.
function(gantry_compile_options target)
  target_compile_options(${target} PRIVATE -Wall -Wextra -Wpedantic -Wshadow -Wnon-virtual-dtor
    $<$<CXX_COMPILER_ID:GNU>:-Wno-restrict>)  # false alarms of g++ 12 in std::string
  if(GANTRY_WERROR)
    target_compile_options(${target} PRIVATE -Werror)
  endif()
  if(GANTRY_SANITIZE)
    # Not one finding may scroll by: undefined behaviour ends the program, as a bad access does.
    target_compile_options(${target} PUBLIC -fsanitize=${GANTRY_SANITIZE} -fno-sanitize-recover=all -fno-omit-frame-pointer)
    target_link_options(${target} PUBLIC -fsanitize=${GANTRY_SANITIZE})
    # Eigen allocates otherwise with AddressSanitizer than without, as Debian's PCL does: whatever one of the
    # two allocates and the other frees would end the program.
    target_compile_definitions(${target} PUBLIC EIGEN_MALLOC_ALREADY_ALIGNED=1)
  endif()
endfunction()

function(gantry_library name)
  add_library(gantry_${name} STATIC ${ARGN})
  add_library(gantry::${name} ALIAS gantry_${name})
  target_include_directories(gantry_${name}
    PUBLIC ${CMAKE_CURRENT_SOURCE_DIR}/include
    PRIVATE ${CMAKE_CURRENT_SOURCE_DIR})
  gantry_compile_options(gantry_${name})
endfunction()
