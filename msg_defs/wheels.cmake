# The PyPI wheels export their Python typesupport libraries with include directories of the machine that built them,
# and CMake refuses an imported target whose include directories do not exist. Nothing here needs those directories
# (rosidl_generator_py adds Python's and numpy's own), so the ones that do not exist are dropped; under a normal ROS 2
# they all exist and nothing changes.
get_property(imported_targets DIRECTORY PROPERTY IMPORTED_TARGETS)
foreach(target IN LISTS imported_targets)
  if(target MATCHES "__rosidl_generator_py$")
    get_target_property(directories ${target} INTERFACE_INCLUDE_DIRECTORIES)
    set(existing)
    foreach(directory IN LISTS directories)
      if(directory MATCHES "^\\$<" OR EXISTS "${directory}")
        list(APPEND existing "${directory}")
      endif()
    endforeach()
    set_target_properties(${target} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${existing}")
  endif()
endforeach()

# The C++ half, which Python does not use: tools/build_messages.sh leaves it out, colcon builds it.
if(PYTHON_ONLY)
  list(FILTER AMENT_EXTENSIONS_rosidl_generate_idl_interfaces EXCLUDE REGEX "cpp:")
endif()
