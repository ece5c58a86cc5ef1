# find_package(torqued) gives the target torqued::torqued.
get_filename_component(_torqued_prefix "${CMAKE_CURRENT_LIST_DIR}/../../.." ABSOLUTE)
if(NOT TARGET torqued::torqued)
  add_library(torqued::torqued SHARED IMPORTED)
  set_target_properties(torqued::torqued PROPERTIES
    IMPORTED_LOCATION "${_torqued_prefix}/lib/libtorqued.so.0"
    IMPORTED_SONAME libtorqued.so.0
    INTERFACE_INCLUDE_DIRECTORIES "${_torqued_prefix}/include")
endif()
unset(_torqued_prefix)
