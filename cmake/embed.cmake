# nusselt_embed(<file> <name> <out.cpp>): the file's bytes as `extern const char* const nusselt::tools::<name>`.
include_guard(GLOBAL)
function(nusselt_embed file name out)
    set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${file})
    file(READ ${file} hex HEX)
    string(REGEX REPLACE "([0-9a-f][0-9a-f])" "0x\\1," bytes "${hex}")
    string(REGEX REPLACE "(................................................................................)" "\\1\n"
        bytes "${bytes}")
    set(text "namespace nusselt::tools {\nnamespace {\nconst unsigned char bytes[] = {\n${bytes}0};\n}\n\
extern const char* const ${name};\nconst char* const ${name} = reinterpret_cast<const char*>(bytes);\n}\n")
    set(before "")
    if(EXISTS ${out})
        file(READ ${out} before)
    endif()
    if(NOT text STREQUAL before)
        file(WRITE ${out} "${text}")
    endif()
endfunction()
