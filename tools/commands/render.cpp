#include "tools/render/render.h"

#include "tools/commands/choice.h"
#include "tools/commands/commands.h"
#include "tools/commands/pvs.h"
#include "tools/report/failure.h"
#include "tools/report/output.h"
#include "tools/report/progress.h"
#include "tools/report/stop.h"
#include "tools/trace/glossy.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>

namespace nusselt::tools {

namespace {

std::vector<float> floats_of(const StreamArray& stream) {
    std::vector<float> values(stream.bytes.size() / sizeof(float));
    std::memcpy(values.data(), stream.bytes.data(), stream.bytes.size());
    return values;
}

std::vector<uint16_t> joined(const Palette& palette) {
    std::vector<uint16_t> all;
    for (const std::vector<uint16_t>& mesh : palette.material_of)
        all.insert(all.end(), mesh.begin(), mesh.end());
    return all;
}

// Radiance of glossy transfer vectors, 75 numbers each.
std::vector<float> shade_glossy(const std::vector<float>& light, const std::vector<float>& transfer) {
    std::vector<float> radiance(transfer.size() / 25);
    for (size_t k = 0; k < radiance.size(); ++k) {
        for (size_t term = 0; term < 25; ++term)
            radiance[k] += light[3 * term + k % 3] * transfer[25 * k + term];
    }
    return radiance;
}

// A stream of floats as three numbers in [0, 1] a vertex.
std::vector<float> as_colours(const StreamArray& stream) {
    const size_t components = stream.element() / sizeof(float);
    std::vector<float> colours;
    for (const float value : floats_of(stream)) {
        if (components == 1) {
            colours.insert(colours.end(), 3, value);
        } else {
            colours.push_back(value * 0.5f + 0.5f);
        }
    }
    return colours;
}

// Numbers in [0, 1], from blue to orange.
std::vector<float> as_heat(const std::vector<float>& parts, float most) {
    constexpr glm::vec3 cold(0.10f, 0.20f, 0.55f), warm(1, 0.55f, 0.10f);
    std::vector<float> colours;
    for (const float part : parts) {
        const float t = most > 0 ? part / most : 0;
        for (int c = 0; c < 3; ++c)
            colours.push_back(cold[c] + (warm[c] - cold[c]) * t);
    }
    return colours;
}

// Seen from behind.
Assembly turned_over(Assembly all) {
    for (glm::vec3& normal : all.normals)
        normal = -normal;
    return all;
}

} // namespace

void run_render(const RenderOptions& options) {
    if (!options.visible_set.empty() && options.shadows != Shadows::on)
        throw Failure("--pvs", "needs --shadows on; leave one of the two out", exit_usage);
    const bool several = options.frames.has_value();
    Choice choice = choose(options.model, options.clip, several || options.time.has_value());
    std::vector<double> times{options.time.value_or(0)};
    if (several) {
        times.clear();
        for (uint32_t k = 0; k < *options.frames; ++k)
            times.push_back(k / options.fps);
        const double last = times.back();
        if (choice.clip >= 0 && last > choice.scene.duration) {
            const auto most = static_cast<uint64_t>(std::floor(choice.scene.duration * options.fps)) + 1;
            throw Failure("--frames",
                          "the last frame lies at " + seconds_text(last) + ", but the clip lasts " +
                              seconds_text(choice.scene.duration) + "; at this --fps it has " +
                              std::to_string(most) + " frames",
                          exit_usage);
        }
        check_time(choice, last, "--frames");
    } else {
        check_time(choice, times[0], "--time");
    }
    std::vector<uint32_t> objects(choice.scene.meshes.size(), 0);
    if (!options.further.paths.empty())
        objects = add_models(choice.scene, options.further, several || options.time.has_value(), times[0]);
    assign_roles(choice.scene, options.roles);
    const Image environment =
        options.environment == "sky" ? sky(1024, 512, 0) : load_environment(options.environment);
    OutputDirectory out(options.out);
    std::vector<float> light = project_environment(environment, options.environment);
    if (options.window) {
        float window[5];
        sh_window(*options.window, options.window_width, window);
        sh_apply_window(window, 3, light.data());
    }

    // One camera for the whole clip.
    scenes::Pose pose;
    Framing framing = make_framing(choice.scene.view_direction, 32, options.width, options.height);
    for (const double time : times) {
        choice.scene.pose(time, pose);
        for (const std::vector<glm::vec3>& positions : pose.positions)
            include(framing, positions);
    }
    const Camera camera = frame_camera(framing);
    std::vector<float> opacity;
    if (options.roles.ground) {
        for (const scenes::Mesh& mesh : choice.scene.meshes)
            opacity.insert(opacity.end(), mesh.rest_positions.size(), 1.0f);
        const std::vector<float> ground = add_ground(choice.scene, times);
        opacity.insert(opacity.end(), ground.begin(), ground.end());
        // Of one object's picture it is a part; among several it is none's.
        objects.push_back(options.further.paths.empty() ? 0 : objects.back() + 1);
    }
    Engine engine(choice.scene, options.engine, options.model);
    std::vector<uint8_t> hide, receive;
    for (const scenes::Mesh& mesh : choice.scene.meshes) {
        hide.push_back(mesh.hides);
        receive.push_back(mesh.receives);
    }

    engine.group(objects);
    engine.fade(options.falloff);
    if (options.watertight) engine.make_watertight();
    if (options.keep) engine.keep_still();
    // A set was recorded with each pose's own origin; what it leaves is the same only with that.
    if (options.visible_set.empty()) engine.hold_origin();
    if (!options.visible_set.empty()) engine.use_visible(read_set(options.visible_set), options.visible_set);
    // Lambert's light is a dot product afterwards; glossy light comes with the frame.
    const bool glossy = options.reflectance.kind != Reflectance::Kind::lambert || options.direct;
    const Palette palette = make_palette(choice.scene, options.reflectance);
    if (glossy && options.shadows == Shadows::on) engine.look(palette, camera.eye, light);
    if (const std::string warning =
            glossy && !options.window && !options.direct ? ringing_warning(palette) : "";
        !warning.empty())
        std::fprintf(stderr, "%s\n", failure_line("--brdf", "warning: " + warning).c_str());
    std::vector<StreamArray> shown;
    if (glossy && options.show == Show::radiance && options.shadows == Shadows::on) {
        shown.resize(1);
        shown[0].kind = options.direct ? OutputKind::direct : OutputKind::radiance;
        if (options.direct) engine.surround(environment, options.quality);
    }
    if (options.show != Show::radiance) {
        shown.resize(1);
        shown[0].kind =
            options.show == Show::bent_normal ? OutputKind::bent_normal : OutputKind::ambient_occlusion;
    }

    engine.make_streams_alone(!shown.empty());
    const bool two_sided = has_backs(choice.scene, options.two_sided);
    BackArrays backs;
    backs.streams = shown;
    if (two_sided) engine.see_backs(options.two_sided, &backs);

    // One scale for all frames, whichever segment each looks at.
    float most_looked_at = 0;
    for (uint32_t s = 0; options.show == Show::visible_set && s < engine.visible_info().segments; ++s) {
        throw_if_interrupted();
        engine.choose_segment(s);
        for (const float part : engine.visible_parts())
            most_looked_at = std::max(most_looked_at, part);
    }

    Progress progress("render");
    float exposure = 0;
    uint64_t receivers = 0, kept = 0;
    for (size_t k = 0; k < times.size(); ++k) {
        throw_if_interrupted();
        choice.scene.pose(times[k], pose);
        if (!options.visible_set.empty())
            engine.choose_segment(
                segment_at(times[k], choice.scene.duration, engine.visible_info().segments));
        const Assembly all = assemble(choice.scene, pose);
        const Assembly drawn = triangles_of(all, choice.scene, receive);
        View view = cast_view(make_trace_scene(drawn), camera, options.width, options.height);
        if (!opacity.empty()) fade_view(view, drawn, opacity);
        const TraceScene traced = make_trace_scene(triangles_of(all, choice.scene, hide));
        std::vector<float> open = open_transfers(all.normals);
        const auto tell = [&](double part) {
            progress.show((static_cast<double>(k) + part) / static_cast<double>(times.size()));
        };
        // Without the library, of one side.
        const auto transfers = [&](const Assembly& side) {
            if (!glossy && options.shadows == Shadows::off) return open_transfers(side.normals);
            std::vector<float> made;
            if (glossy) {
                GlossyOptions trace;
                trace.rays = options.rays;
                trace.shadows = options.shadows == Shadows::traced;
                trace.cancel = &interrupted();
                trace.progress = tell;
                made = trace_glossy(traced, side, palette.materials, joined(palette), camera.eye, {}, trace);
            } else {
                TraceOptions trace;
                trace.rays = options.rays;
                trace.cancel = &interrupted();
                trace.progress = tell;
                made = trace_transfer(traced, side, trace).transfer;
            }
            throw_if_interrupted();
            return made;
        };
        std::vector<float> transfer;
        if (options.shadows == Shadows::on) {
            const FrameStats stats = engine.frame(pose, options.quality, transfer, nullptr, &shown);
            receivers += stats.receivers;
            kept += stats.receivers_reused;
        } else {
            transfer = transfers(all);
            if (two_sided) backs.transfer = transfers(turned_over(all));
        }
        // From the first frame, white and unshadowed: so pictures compare with and without shadows, a clip
        // doesn't flicker, and what is dark stays dark.
        if (k == 0) {
            const std::vector<glm::vec3> white(all.positions.size(), glm::vec3(1));
            exposure =
                exposure_for(color_view(view, drawn, engine.shade(light.data(), open, white)), view.covered);
        }
        char name[32];
        std::snprintf(name, sizeof name, "frame_%04zu.png", k);
        std::vector<float> looked_at;
        if (options.show == Show::visible_set) looked_at = engine.visible_parts();
        const auto colours_of = [&](std::vector<float>& side, const std::vector<StreamArray>& streams) {
            if (options.show == Show::visible_set) return as_heat(looked_at, most_looked_at);
            if (options.show != Show::radiance) return as_colours(streams[0]);
            return !glossy           ? engine.shade(light.data(), side, all.albedo)
                   : streams.empty() ? shade_glossy(light, side)
                                     : floats_of(streams[0]);
        };
        BackRadiance behind;
        if (two_sided) {
            behind.radiance = colours_of(backs.transfer, backs.streams);
            behind.has_back = all.two_sided;
            if (options.two_sided == TwoSided::all) behind.has_back.assign(all.positions.size(), 1);
        }
        const Image colored = color_view(view, drawn, colours_of(transfer, shown), behind);
        const Picture picture = options.show == Show::radiance
                                    ? finish_view(view, colored, exposure, &environment)
                                    : show_view(view, colored);
        out.add(name, encode_png(picture));
        progress.show((static_cast<double>(k) + 1) / static_cast<double>(times.size()));
    }
    out.commit();
    std::printf("%s: %zu frame%s of %u x %u\n", printable(out.path()).c_str(), times.size(),
                times.size() == 1 ? "" : "s", options.width, options.height);
    if (options.show == Show::visible_set)
        std::printf("orange: %.1f %% of the clusters are looked at\n", 100 * double(most_looked_at));
    if (options.keep)
        std::printf("kept: %.1f %% of the receivers, as nothing had changed for them\n",
                    100.0 * static_cast<double>(kept) /
                        static_cast<double>(std::max<uint64_t>(receivers, 1)));
}

} // namespace nusselt::tools
