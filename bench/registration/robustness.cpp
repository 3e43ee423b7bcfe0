#include "bench.h"
#include "markdown.h"

namespace gantry::bench {
namespace {

constexpr const char* kSection = "robustness";

/// A trouble, and the part that meets it.
struct Trouble {
  std::string name, part;
  ScanSettings settings = {};
  bool holder = false;
};

std::vector<Trouble> troubles() {
  std::vector<Trouble> all = {{"none", "bracket"}, {"none", "prismatic-block"}};
  const auto add = [&](const std::string& name, const std::string& part) -> Trouble& {
    all.push_back({name, part});
    return all.back();
  };
  add("the holder in view", "bracket").holder = true;
  add("no shadows", "bracket").settings.sensor.projector_offset_mm = 0;
  add("long shadows (projector 250 mm aside)", "bracket").settings.sensor.projector_offset_mm = 250;
  for (const char* part : {"bracket", "prismatic-block"})
    add("a quarter of the pixels lost in dark patches", part).settings.dark_fraction = 0.25;
  for (const char* part : {"bracket", "slim-lever"})
    add("all pixels at depth steps mixed", part).settings.sensor.mixed_pixel_probability = 1;
  for (const double noise : {0.01, 0.1, 0.3})
    for (const char* part : {"bracket", "prismatic-block"})
      add(text("noise %g mm", noise), part).settings.sensor.noise_mm = noise;
  for (const char* part : {"bracket", "prismatic-block"})
    add("4 views, little overlap", part).settings.views = 4;
  add("20 views", "bracket").settings.views = 20;
  add("plate, 3 mm", "plate");
  add("turned, three bumps", "turned-bumps");
  add("turned, no feature: the angle cannot be seen", "turned");
  return all;
}

}  // namespace

std::string robustness(Bench& bench) {
  const Band band{3, 6};
  const size_t draws = (3 * bench.options.draws + 9) / 10;
  Table table({"trouble", "part", "solved", "undecided", "false", "needless", "dmax mm, median (worst)",
               "element difference", "CPU s"});
  for (const Trouble& trouble : troubles()) {
    bench.progress.stage("robustness: " + trouble.part + ", " + trouble.name);
    const ScannedPart scanned(trouble.part, bench.options.bunny, trouble.holder);
    const ScanSet set = scanned.scan(trouble.settings);
    PreparedMethod joint = prepare(make_method("joint"), set);
    for (size_t d = 0; d < draws; ++d) {
      RunRecord run = judged_run(joint, set, initial_poses(set, band.from, band.to, 1000 + d));
      run.section = kSection;
      run.part = trouble.part;
      run.method = "joint";
      run.label = trouble.name;
      run.draw = d;
      bench.records.push_back(std::move(run));
    }
    const Tally t = tally(bench.select(kSection, trouble.part, "joint", trouble.name));
    table.add({trouble.name, trouble.part, text("%zu of %zu", t.successes, t.runs), text("%zu", t.undecided),
               text("%zu", t.false_success), text("%zu", t.needless_undecided),
               short_number(t.dmax_median_mm) + " (" + short_number(t.dmax_worst_mm) + ")",
               short_number(t.mae16_median), text("%.2f", t.preparation.cpu_s + t.registration.cpu_s)});
  }
  return "## Trouble\nMethod joint, initial poses off by " + band.name() +
         " degrees and mm, eight views and noise 0.05 mm unless said otherwise. A part that is turned "
         "without any "
         "feature has no right answer about its axis, nor has a scan that does not see the bumps: "
         "*undecided* is the right word for it, and so it may be "
         "where "
         "little overlaps.\n\n" +
         table.str();
}

}  // namespace gantry::bench
