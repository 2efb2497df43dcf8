# Lets CMake build interface packages against ROS that pip has installed: CMAKE_PROJECT_INCLUDE names this file.
#
# The wheels' exports name the folders of Python and NumPy as they were where the wheels were built. CMake stops at a
# folder that is not there, so these are taken from the targets, at the end of each project; the generators find the
# Python that is at hand by themselves.

function(forget_missing_folders)
  get_property(targets DIRECTORY PROPERTY IMPORTED_TARGETS)
  foreach(target IN LISTS targets)
    get_target_property(folders ${target} INTERFACE_INCLUDE_DIRECTORIES)
    if(folders)
      set(there)
      foreach(folder IN LISTS folders)
        if(folder MATCHES "^\\$<" OR EXISTS "${folder}")
          list(APPEND there "${folder}")
        endif()
      endforeach()
      set_target_properties(${target} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${there}")
    endif()
  endforeach()
endfunction()

cmake_language(DEFER CALL forget_missing_folders)
