#include "builtin.h"

namespace nusselt::scenes {

std::vector<std::string> builtin_names() {
    return {"cloth", "fight", "chess", "hand"};
}

Scene builtin(const std::string& name) {
    if (name == "cloth") return make_cloth();
    if (name == "fight") return make_fight();
    if (name == "chess") return make_chess();
    if (name == "hand") return make_hand();
    return {};
}

} // namespace nusselt::scenes
