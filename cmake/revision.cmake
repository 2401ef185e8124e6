# Writes OUT with the revision of the sources in ROOT. Usage: cmake -DROOT=... -DOUT=... -P revision.cmake
execute_process(COMMAND git -C ${ROOT} describe --always --dirty --abbrev=10
    OUTPUT_VARIABLE revision OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET RESULT_VARIABLE failed)
if(failed OR NOT revision MATCHES "^[A-Za-z0-9._-]+$")
    set(revision "unknown")
endif()
set(text "#pragma once\n#define NUSSELT_REVISION \"${revision}\"\n")
set(before "")
if(EXISTS ${OUT})
    file(READ ${OUT} before)
endif()
if(NOT text STREQUAL before)
    file(WRITE ${OUT} "${text}")
endif()
