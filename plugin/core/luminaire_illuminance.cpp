#include "core/luminaire_illuminance.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "core/luminaire_shape.h"
#include "core/luminous_outline.h"
#include "core/sampling.h"

namespace isolux {
namespace {

constexpr double kPi = std::numbers::pi;

// A luminaire with a goniometric diagram is a point from so many of its openings on. Nearer, the
// paper's rule of five times [Volevich 2000, §3.1.1; CIE 121] holds for light that varies as slowly
// as a cosine: from a wall-washer's beam it is 1.8 % off at eleven openings.
// Departure: more than five; nearer, points over the opening as many as it takes.
constexpr double kPointOpenings = 25.0, kTriedAsPoint = 7.0;
// The same for constant luminance, 0.01 % off, and for tubes, whose light starts aside of the axis.
constexpr double kExactOpenings = 50.0;

// From so many openings on any one point tells about as much as all.
constexpr double kOnePointOpenings = 2.0;

// Gauss' three points on [0, 1].
constexpr double kGaussOffset = 0.3872983346207417;
constexpr std::array<double, 3> kGaussPoints{0.5 - kGaussOffset, 0.5, 0.5 + kGaussOffset};
constexpr std::array<double, 3> kGaussWeights{5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0};
constexpr std::array<double, 2> kGaussPair{0.21132486540518712, 0.7886751345948129};
// Parts of each side of a luminaire that get the Gaussian points, for each opening of its distance:
// as a rule; twice as many until both agree.
constexpr double kPartsPerOpening = 2.0;
constexpr int kMostParts = 16;
constexpr double kAgreeing = 0.01; // the finer of the two is about four times nearer to the truth

// Of what an even luminaire gives to a receiver that faces it: less needn't be known that well.
constexpr double kFaint = 0.1;

// Of a radius: a receiver that is no farther inside of a luminaire touches it, but for rounding;
// and of the radius squared, how far outside it is taken to be.
constexpr double kTouching = 1e-6, kOutside = 1e-12;

// Squared distance from the surface of a round luminaire along its tangent, m²; of what is inside,
// 0 or less.
double tangent_squared(double squared_distance, double radius) {
    const double squared_radius = radius * radius;
    const double beyond = squared_distance - squared_radius;
    return beyond > -2.0 * kTouching * squared_radius ? std::max(beyond, kOutside * squared_radius)
                                                      : beyond;
}

// What a receiver at `from`, local, sees of a cylinder: angles within half_arc of `near`, about X.
struct CylinderSide {
    double distance, half_arc; // m from the axis; rad
    Vec3d near, across;        // unit

    CylinderSide(const CylinderLuminaire& s, const Vec3d& from)
        : distance(std::sqrt(s.radius * s.radius +
                             tangent_squared(from.y * from.y + from.z * from.z, s.radius))),
          half_arc(std::atan2(std::sqrt(std::max(0.0, distance * distance - s.radius * s.radius)),
                              s.radius)),
          near{0.0, from.y / distance, from.z / distance}, across{0.0, -near.z, near.y} {}
};

} // namespace

LuminaireIlluminance::LuminaireIlluminance(const Luminaire& luminaire)
    : luminaire_(luminaire), is_infinite_(luminaire.is_infinite()),
      radius_(bounding_radius(luminaire.shape)),
      reach_(luminaire.diagram != nullptr ? luminaire.diagram->widest_gamma()
                                          : (is_flat(luminaire.shape) ? 0.5 : 1.0) * kPi),
      point_openings_(std::holds_alternative<CylinderLuminaire>(luminaire.shape) ? kExactOpenings
                                                                                 : kPointOpenings),
      area_(luminous_area(luminaire.shape)),
      scale_(luminaire.luminous_flux /
             (luminaire.diagram != nullptr ? luminaire.diagram->luminous_flux() : 1.0)) {}

bool LuminaireIlluminance::follows_cosine() const {
    return luminaire_.diagram == nullptr && is_flat(luminaire_.shape);
}

double LuminaireIlluminance::peak_intensity() const {
    return scale_ * (luminaire_.diagram != nullptr ? luminaire_.diagram->peak_intensity()
                                                   : profile(luminaire_.shape, {0.0, 0.0, -1.0}));
}

double LuminaireIlluminance::intensity(const Vec3d& to) const {
    const Vec3d local = -to_local(to);
    return scale_ * (luminaire_.diagram != nullptr
                         ? luminaire_.diagram->intensity(local)
                         : profile(luminaire_.shape, local * (1.0 / length(local))));
}

bool LuminaireIlluminance::is_far(const Vec3d& to, const Vec3d& normal, double openings) const {
    const double limit = 2.0 * radius_ * openings;
    return dot(to, to) >= limit * limit && dot(to, normal) >= radius_;
}

double LuminaireIlluminance::from_infinity(const Vec3d& normal) const {
    if (const auto* distant = std::get_if<DistantLuminaire>(&luminaire_.shape)) {
        return distant->illuminance(luminaire_.z, normal);
    }
    const auto& dome = std::get<DomeLuminaire>(luminaire_.shape);
    return luminance(dome.luminance->illuminance(to_local(normal)));
}

// Of a dome one of several directions by its share of their illuminance [resampled importance
// sampling, Talbot et al. 2005].
ShadowSample LuminaireIlluminance::infinite_sample(const Receiver& receiver, double u,
                                                   double v) const {
    const Vec3d normal = receiver.normal.as<double>();
    if (const auto* distant = std::get_if<DistantLuminaire>(&luminaire_.shape)) {
        const Vec3d to_light = distant->direction(luminaire_.z, u, v);
        return {distant->entry->beyond(receiver.position, to_light),
                std::max(0.0, dot(to_light, normal)), luminaire_.colour};
    }
    const auto& dome = std::get<DomeLuminaire>(luminaire_.shape);
    constexpr int kCandidates = 8;
    std::array<DomeLuminance::Sample, kCandidates> candidates;
    std::array<double, kCandidates> weights{};
    double sum = 0.0;
    for (int k = 0; k < kCandidates; ++k) {
        const auto turned = [](double a) { return a - std::floor(a); };
        candidates[k] = dome.luminance->sample(turned(u + static_cast<double>(k) / kCandidates),
                                               turned(v + k * std::numbers::phi));
        weights[k] = std::max(0.0, dot(to_world(candidates[k].direction), normal));
        sum += weights[k];
    }
    // What chose among the candidates' shifts has digits left.
    double chosen = (u * kCandidates * 512.0 - std::floor(u * kCandidates * 512.0)) * sum;
    int k = 0;
    while (k + 1 < kCandidates && chosen >= weights[k]) {
        chosen -= weights[k++];
    }
    const Vec3f& light = candidates[k].luminance;
    return {dome.entry->beyond(receiver.position, to_world(candidates[k].direction)), weights[k],
            light * (1.0F / luminance(light))};
}

double LuminaireIlluminance::unoccluded(const Receiver& receiver) const {
    if (is_infinite_) {
        return from_infinity(receiver.normal.as<double>());
    }
    const Vec3d to = luminaire_.position - receiver.position;
    const Vec3d normal = receiver.normal.as<double>();
    const double height = dot(to, normal);
    if (height <= -radius_ || (height <= 0.0 && radius_ == 0.0) ||
        luminaire_.lies_in(height, receiver.normal)) {
        return 0.0;
    }
    const bool constant = luminaire_.diagram == nullptr && area_ > 0.0;
    if (is_far(to, normal, constant ? kExactOpenings : point_openings_)) {
        return as_point(receiver);
    }
    return constant ? constant_luminance(to, normal) : quadrature(receiver);
}

double LuminaireIlluminance::constant_luminance(const Vec3d& to, const Vec3d& normal) const {
    const double luminance = luminaire_.luminous_flux / (kPi * area_);
    // In local axes, from the receiver.
    const Vec3d c = to_local(to), n = to_local(normal);
    LuminousOutline outline(n);
    const auto seen =
        std::visit(Overloaded{
                       [&](const SphereLuminaire& s) {
                           const double squared = dot(c, c);
                           const double inside = tangent_squared(squared, s.radius);
                           if (inside <= 0.0) {
                               return false;
                           }
                           const double distance = std::sqrt(squared);
                           const auto [a, b] = tangents(c * (1.0 / distance));
                           const double radius = s.radius * std::sqrt(inside) / distance;
                           outline.add_circle({c * (inside / squared), a * radius, b * radius});
                           return true;
                       },
                       [&](const DiskLuminaire& s) {
                           if (c.z <= 0.0) {
                               return false;
                           }
                           const double off = std::hypot(c.x, c.y);
                           const Vec3d a =
                               off > 0.0 ? Vec3d{c.x / off, c.y / off, 0.0} : Vec3d{1.0, 0.0, 0.0};
                           outline.add_circle({c, a * s.radius, Vec3d{-a.y, a.x, 0.0} * s.radius});
                           return true;
                       },
                       [&](const RectLuminaire& s) {
                           if (c.z <= 0.0) {
                               return false;
                           }
                           const Vec3d a{0.5 * s.width, 0.0, 0.0}, b{0.0, 0.5 * s.height, 0.0};
                           const std::array corners{c - a - b, c + a - b, c + a + b, c - a + b};
                           for (std::size_t i = 0; i < corners.size(); ++i) {
                               outline.add_segment(corners[i], corners[(i + 1) % corners.size()]);
                           }
                           return true;
                       },
                       [&](const CylinderLuminaire& s) {
                           const CylinderSide side(s, -c);
                           if (side.distance <= s.radius) {
                               return false;
                           }
                           const Vec3d end{0.5 * s.length, 0.0, 0.0};
                           const Vec3d a = side.near * s.radius, b = side.across * s.radius;
                           const CircleOfView high{c + end, a, b}, low{c - end, a, b};
                           outline.add_arc(high, -side.half_arc, side.half_arc);
                           outline.add_segment(high.at(side.half_arc), low.at(side.half_arc));
                           const CircleOfView turned{low.centre, a, -b}; // the other way round
                           outline.add_arc(turned, -side.half_arc, side.half_arc);
                           outline.add_segment(low.at(-side.half_arc), high.at(-side.half_arc));
                           return true;
                       },
                       [&](const TriangleLuminaire& s) {
                           if (c.z <= 0.0) {
                               return false;
                           }
                           outline.add_segment(c + s.a, c + s.b);
                           outline.add_segment(c + s.b, c + s.c);
                           outline.add_segment(c + s.c, c + s.a);
                           return true;
                       },
                       [](const auto&) { return false; },
                   },
                   luminaire_.shape);
    return seen ? luminance * outline.projected_solid_angle() : 0.0;
}

LuminaireIlluminance::Sight LuminaireIlluminance::sight(const Receiver& receiver, double u,
                                                        double v) const {
    const Vec3d to = luminaire_.position - receiver.position;
    const Vec3d normal = receiver.normal.as<double>();
    const auto from_point = [&](const Vec3d& local) {
        const Vec3d at = to + to_world(local);
        const double squared = dot(at, at);
        const double factor = dot(at, normal) / (squared * std::sqrt(squared));
        return Sight{at, squared > 0.0 ? std::max(0.0, factor) : 0.0};
    };
    return std::visit(
        Overloaded{
            // A point of the disk that the silhouette bounds, lifted to the near side.
            [&](const SphereLuminaire& s) {
                const double squared = dot(to, to), inside = tangent_squared(squared, s.radius);
                if (inside <= 0.0) {
                    return Sight{to, 0.0};
                }
                const double distance = std::sqrt(squared);
                const Vec3d middle = to * (1.0 / distance);
                const auto [a, b] = tangents(middle);
                const double r = s.radius * std::sqrt(inside * u) / distance;
                const auto [cosine, sine] = on_circle(v);
                const Vec3d at = to * (inside / squared) + a * (r * cosine) + b * (r * sine);
                const double reach = length(at);
                const Vec3d direction = at * (1.0 / reach);
                const double along = dot(direction, to);
                const double near = along - std::sqrt(std::max(0.0, along * along - inside));
                const double factor = inside / squared * std::max(0.0, dot(direction, normal)) *
                                      dot(direction, middle) / (reach * reach);
                return Sight{direction * near, factor};
            },
            [&](const DiskLuminaire& s) {
                const double r = s.radius * std::sqrt(u);
                const auto [cosine, sine] = on_circle(v);
                return from_point({r * cosine, r * sine, 0.0});
            },
            [&](const RectLuminaire& s) {
                return from_point({(u - 0.5) * s.width, (v - 0.5) * s.height, 0.0});
            },
            [&](const CylinderLuminaire& s) {
                const CylinderSide side(s, to_local(-to));
                if (side.distance <= s.radius) {
                    return Sight{to, 0.0};
                }
                if (side.half_arc < 2.0 * std::sqrt(kOutside)) { // nothing hides what touches
                    return Sight{normal * (kTouching * s.radius), 1.0};
                }
                const double angle = (2.0 * v - 1.0) * side.half_arc;
                const Vec3d across = side.near * std::cos(angle) + side.across * std::sin(angle);
                const Vec3d along{(u - 0.5) * s.length, 0.0, 0.0};
                Sight out = from_point(along + across * s.radius);
                const Vec3d back = to_local(-out.to);
                out.factor *=
                    side.half_arc * std::max(0.0, dot(back, across)) / std::hypot(back.y, back.z);
                return out;
            },
            [&](const TriangleLuminaire& s) { return from_point(s.point(u, v)); },
            [&](const auto&) { return Sight{to, 0.0}; },
        },
        luminaire_.shape);
}

double LuminaireIlluminance::as_point(const Receiver& receiver) const {
    const Vec3d to = luminaire_.position - receiver.position;
    const double squared = dot(to, to);
    return intensity(to) * dot(to, receiver.normal.as<double>()) / (squared * std::sqrt(squared));
}

double LuminaireIlluminance::quadrature(const Receiver& receiver) const {
    const Vec3d to = luminaire_.position - receiver.position;
    const bool is_tube = std::holds_alternative<CylinderLuminaire>(luminaire_.shape);
    const bool point = !is_tube && is_far(to, receiver.normal.as<double>(), kTriedAsPoint);
    const double gap = std::max(length(to) - radius_, 0.0);
    const double wanted = kPartsPerOpening * 2.0 * radius_;
    int parts = 0; // none: four points
    while (2 * parts < kMostParts && std::max(1, 2 * parts) * gap < wanted) {
        parts = std::max(1, 2 * parts);
    }
    double found = point ? as_point(receiver) : by_points(receiver, parts);
    parts = point ? 0 : std::max(1, 2 * parts);
    double finer = by_points(receiver, parts);
    const double squared = std::max(dot(to, to), radius_ * radius_);
    const double faint = kFaint * luminaire_.luminous_flux / (4.0 * kPi * squared);
    while (std::abs(finer - found) > kAgreeing * std::max(finer, faint) && parts < kMostParts) {
        parts = std::max(1, 2 * parts);
        found = finer;
        finer = by_points(receiver, parts);
    }
    return finer;
}

// parts: of each side, each with Gauss' points; 0: four points for all, which are exact for cubics.
double LuminaireIlluminance::by_points(const Receiver& receiver, int parts) const {
    // Around a circle evenly, which is exact for all harmonics below the number of points.
    const bool round = std::holds_alternative<SphereLuminaire>(luminaire_.shape) ||
                       std::holds_alternative<DiskLuminaire>(luminaire_.shape);
    double sum = 0.0;
    if (parts == 0) {
        for (int i = 0; i < 4; ++i) {
            const double u = round ? 0.5 : kGaussPair[i % 2];
            const Sight s = sight(receiver, u, round ? (i + 0.5) / 4.0 : kGaussPair[i / 2]);
            sum += s.factor > 0.0 ? 0.25 * s.factor * intensity(s.to) : 0.0;
        }
        return sum;
    }
    const int columns = (round ? 6 : 3) * parts, rows = 3 * parts;
    // A point that is nearer than its share of the opening spreads its light over the hemisphere.
    const double area = area_ / (rows * columns);
    for (int i = 0; i < rows; ++i) {
        const double u = (i / 3 + kGaussPoints[i % 3]) / parts;
        for (int j = 0; j < columns; ++j) {
            const double v = round ? (j + 0.5) / columns : (j / 3 + kGaussPoints[j % 3]) / parts;
            const double weight = kGaussWeights[i % 3] * (round ? 1.0 / 6.0 : kGaussWeights[j % 3]);
            const Sight s = sight(receiver, u, v);
            if (s.factor > 0.0) {
                const double factor = area > 0.0 ? std::min(s.factor, kPi / area) : s.factor;
                sum += weight * factor * intensity(s.to);
            }
        }
    }
    return sum / (parts * parts);
}

ShadowSample LuminaireIlluminance::shadow_sample(const Receiver& receiver, double u,
                                                 double v) const {
    if (is_infinite_) {
        return infinite_sample(receiver, u, v);
    }
    const Sight s = sight(receiver, u, v);
    double weight = s.factor;
    const Vec3d to = luminaire_.position - receiver.position;
    const bool point =
        luminaire_.diagram != nullptr && is_far(to, receiver.normal.as<double>(), point_openings_);
    if (weight > 0.0 && !point) {
        weight *= intensity(s.to);
    }
    return {receiver.position + s.to, weight, luminaire_.colour};
}

bool LuminaireIlluminance::one_point_tells(const Vec3d& to) const {
    const double limit = 2.0 * radius_ * kOnePointOpenings;
    return !is_infinite_ && dot(to, to) >= limit * limit;
}

double LuminaireIlluminance::about(const Receiver& receiver) const {
    const Vec3d to = luminaire_.position - receiver.position;
    if (!one_point_tells(to)) {
        return unoccluded(receiver);
    }
    const double height = dot(to, receiver.normal.as<double>());
    if (height <= -radius_ || luminaire_.lies_in(height, receiver.normal)) {
        return 0.0;
    }
    // Of a luminaire that the horizon cuts, the mean over what is above.
    const double above =
        height >= radius_ ? height : (height + radius_) * (height + radius_) / (4.0 * radius_);
    const double squared = dot(to, to);
    return (intensity(to) + kEvenIntensity * luminaire_.luminous_flux) * above /
           (squared * std::sqrt(squared));
}

ShadowSample LuminaireIlluminance::light_sample(const Receiver& receiver, double u,
                                                double v) const {
    const Vec3d to = luminaire_.position - receiver.position;
    if (!one_point_tells(to)) {
        ShadowSample sample = shadow_sample(receiver, u, v);
        sample.weight = sample.weight > 0.0 ? unoccluded(receiver) : 0.0;
        return sample;
    }
    if (luminaire_.lies_in(dot(to, receiver.normal.as<double>()), receiver.normal)) {
        return {receiver.position + to, 0.0, luminaire_.colour};
    }
    const Sight s = sight(receiver, u, v);
    return {receiver.position + s.to, s.factor > 0.0 ? s.factor * intensity(s.to) : 0.0,
            luminaire_.colour};
}

} // namespace isolux
