#include "tools/commands/commands.h"

int main(int argc, char** argv) {
    return nusselt::tools::run_program(argc, argv);
}
