# Run by cpack before it packs: a .tar.zst gets the libraries that program and library need, but those
# of libc and of the compiler, which a Vulkan driver brings, and which have to be the system's for it.
if(NOT CPACK_GENERATOR STREQUAL "TZST")
  return()
endif()
file(GLOB_RECURSE programs ${CPACK_TEMPORARY_INSTALL_DIRECTORY}/bin/lpvbake)
file(GLOB_RECURSE modules ${CPACK_TEMPORARY_INSTALL_DIRECTORY}/lib/*.so)
file(GET_RUNTIME_DEPENDENCIES EXECUTABLES ${programs} MODULES ${modules}
  RESOLVED_DEPENDENCIES_VAR libraries UNRESOLVED_DEPENDENCIES_VAR missing
  PRE_EXCLUDE_REGEXES "^ld-linux" "^lib(c|m|dl|rt|pthread|resolv|util|stdc[+][+]|gcc_s)[.]so"
  POST_EXCLUDE_REGEXES "^${CPACK_TEMPORARY_INSTALL_DIRECTORY}")
if(missing)
  message(FATAL_ERROR "cannot be found: ${missing}")
endif()
foreach(library ${libraries} ${CPACK_VULKAN_LOADER}) # which is loaded at run time
  file(INSTALL ${library} DESTINATION ${CPACK_TEMPORARY_INSTALL_DIRECTORY}/lib/lpvbake FOLLOW_SYMLINK_CHAIN)
endforeach()
