/* Planners of OMPL on a planar arm, their motions swept: see ompl_planners.py. Nothing of the package is used here.
 *
 * A goal for the tip is a region that holds the poses given to it; XXL's decomposition has the arm's middle and its
 * tip as layers, as in OMPL's own demonstration (Luna, Moll, Badger and Kavraki, IJRR 2020). */

#include <cstdint>
#include <cstring>
#include <ctime>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include <Eigen/Dense>
#include <ompl/base/MotionValidator.h>
#include <ompl/base/ProjectionEvaluator.h>
#include <ompl/base/goals/GoalSampleableRegion.h>
#include <ompl/base/spaces/RealVectorStateSpace.h>
#include <ompl/geometric/SimpleSetup.h>
#include <ompl/geometric/planners/informedtrees/BITstar.h>
#include <ompl/geometric/planners/kpiece/KPIECE1.h>
#include <ompl/geometric/planners/rrt/RRTConnect.h>
#include <ompl/geometric/planners/stride/STRIDE.h>
#include <ompl/geometric/planners/xxl/XXL.h>
#include <ompl/geometric/planners/xxl/XXLPlanarDecomposition.h>
#include <ompl/util/Console.h>
#include <ompl/util/RandomNumbers.h>

#include "swept_links.h"

namespace ob = ompl::base;
namespace og = ompl::geometric;

namespace {

/* What counts as the goal: a disc for the tip and a range of its heading, or one pose (position < 0). */
struct GoalSet {
    double x, y, position, heading, heading_tolerance;
};

const double *bends(const ob::State *state) { return state->as<ob::RealVectorStateSpace::StateType>()->values; }
double *bends(ob::State *state) { return state->as<ob::RealVectorStateSpace::StateType>()->values; }

/* Joint positions of the first count links, (count + 1) points. */
std::vector<Eigen::Vector2d> joints(const Scene &scene, const double *angles, long count) {
    std::vector<Eigen::Vector2d> points{Eigen::Vector2d(scene.base[0], scene.base[1])};
    double heading = scene.heading;
    for (long i = 0; i < count; ++i) {
        heading += angles[i];
        points.push_back(points.back() + scene.length * Eigen::Vector2d(std::cos(heading), std::sin(heading)));
    }
    return points;
}

bool pose_free(const Scene &scene, const ob::State *state) {
    return part_free(&scene, bends(state), bends(state), 0.0, 0.0) == 1;
}

class SweptMotions : public ob::MotionValidator {
public:
    SweptMotions(const ob::SpaceInformationPtr &information, const Scene &scene)
        : ob::MotionValidator(information), scene_(scene) {}

    bool checkMotion(const ob::State *from, const ob::State *to) const override {
        return motion_free(&scene_, bends(from), bends(to)) == 1;
    }

    /* The free part is known to an eighth of the way. */
    bool checkMotion(const ob::State *from, const ob::State *to, std::pair<ob::State *, double> &valid) const override {
        constexpr int parts = 8;
        int good = 0;
        while (good < parts &&
               part_free(&scene_, bends(from), bends(to), double(good) / parts, double(good + 1) / parts) == 1)
            ++good;
        if (good == parts) return true;
        valid.second = double(good) / parts;
        if (valid.first != nullptr) si_->getStateSpace()->interpolate(from, to, valid.second, valid.first);
        return false;
    }

private:
    const Scene &scene_;
};

class TipProjection : public ob::ProjectionEvaluator {
public:
    TipProjection(const ob::StateSpacePtr &space, const Scene &scene) : ob::ProjectionEvaluator(space), scene_(scene) {}
    unsigned int getDimension() const override { return 2; }
    void defaultCellSizes() override { cellSizes_ = {0.1 * scene_.links * scene_.length, 0.1 * scene_.links * scene_.length}; }
    void project(const ob::State *state, Eigen::Ref<Eigen::VectorXd> projection) const override {
        projection = joints(scene_, bends(state), scene_.links).back();
    }

private:
    const Scene &scene_;
};

class GoalRegion : public ob::GoalSampleableRegion {
public:
    GoalRegion(const ob::SpaceInformationPtr &information, const Scene &scene, const GoalSet &set, const double *poses,
               long count)
        : ob::GoalSampleableRegion(information), scene_(scene), set_(set), poses_(poses), count_(count) {
        setThreshold(1.0);
    }

    double distanceGoal(const ob::State *state) const override {
        const double *angles = bends(state);
        double heading = scene_.heading, off = 0.0;
        for (long i = 0; i < scene_.links; ++i) {
            heading += angles[i];
            off = std::max(off, std::fabs(angles[i] - poses_[i]));
        }
        if (set_.position < 0.0) return 1e6 * off;
        Eigen::Vector2d tip = joints(scene_, angles, scene_.links).back();
        double place = (tip - Eigen::Vector2d(set_.x, set_.y)).norm() / set_.position;
        double turn = std::fabs(std::remainder(heading - set_.heading, 2.0 * M_PI)) / set_.heading_tolerance;
        return std::max(place, turn);
    }

    void sampleGoal(ob::State *state) const override {
        next_ = (next_ + 1) % count_;
        std::memcpy(bends(state), poses_ + next_ * scene_.links, sizeof(double) * std::size_t(scene_.links));
    }

    unsigned int maxSampleCount() const override { return unsigned(count_); }

private:
    const Scene &scene_;
    const GoalSet set_;
    const double *poses_;
    long count_;
    mutable long next_ = -1;
};

/* Cells of the plane for the arm's middle and for its tip; poses are drawn by damped least squares from a seed. */
class Layers : public og::XXLPlanarDecomposition {
public:
    Layers(const ob::SpaceInformationPtr &information, const Scene &scene, const ob::RealVectorBounds &box, int slices)
        : og::XXLPlanarDecomposition(box, {slices, slices}, 1, true), information_(information), scene_(scene) {
        if (scene.links > 6) ends_.push_back(scene.links / 2);
        ends_.push_back(scene.links);
    }

    int numLayers() const override { return int(ends_.size()); }

    void project(const ob::State *state, std::vector<double> &place, int layer) const override {
        Eigen::Vector2d end = joints(scene_, bends(state), ends_[std::size_t(layer)]).back();
        place = {end.x(), end.y(), 0.0};
    }

    void project(const ob::State *state, std::vector<int> &layers) const override {
        layers.resize(ends_.size());
        for (std::size_t k = 0; k < ends_.size(); ++k) {
            std::vector<double> place;
            project(state, place, int(k));
            layers[k] = coordToRegion(place);
        }
    }

    bool sampleFromRegion(int region, ob::State *state, const ob::State *seed) const override {
        return sampleFromRegion(region, state, seed, 0);
    }

    bool sampleFromRegion(int region, ob::State *state, const ob::State *seed, int layer) const override {
        long first = layer > 0 ? ends_[std::size_t(layer) - 1] : 0;
        long last = ends_[std::size_t(layer)];
        for (int attempt = 0; attempt < 5; ++attempt) {
            double *angles = bends(state);
            for (long i = 0; i < scene_.links; ++i) {
                if (i < first && seed != nullptr)
                    angles[i] = bends(seed)[i];
                else
                    angles[i] = scene_.limits[i] * rng_.uniformReal(-1.0, 1.0) * std::min(1.0, 12.0 / double(scene_.links));
            }
            std::vector<double> wanted(3);
            sampleCoordinateFromRegion(region, wanted);
            if (bent_to(Eigen::Vector2d(wanted[0], wanted[1]), angles, first, last) && information_->isValid(state)) {
                std::vector<double> place;
                project(state, place, layer);
                if (coordToRegion(place) == region) return true;
            }
        }
        return false;
    }

private:
    /* Bends links first to last - 1 until the last one ends at a place; false when it does not come there. */
    bool bent_to(const Eigen::Vector2d &wanted, double *angles, long first, long last) const {
        const double near = 1e-3 * scene_.length;
        for (int step = 0; step < 50; ++step) {
            std::vector<Eigen::Vector2d> points = joints(scene_, angles, last);
            Eigen::Vector2d error = wanted - points.back();
            if (error.norm() < near) return true;
            Eigen::MatrixXd jacobian(2, last - first);
            for (long i = first; i < last; ++i) {
                Eigen::Vector2d arm = points.back() - points[std::size_t(i)];
                jacobian.col(i - first) = Eigen::Vector2d(-arm.y(), arm.x());
            }
            Eigen::Matrix2d square = jacobian * jacobian.transpose() + 1e-6 * Eigen::Matrix2d::Identity();
            Eigen::VectorXd turn = jacobian.transpose() * square.ldlt().solve(error);
            double largest = turn.cwiseAbs().maxCoeff();
            if (largest > 0.3) turn *= 0.3 / largest;
            for (long i = first; i < last; ++i)
                angles[i] = std::max(-scene_.limits[i], std::min(scene_.limits[i], angles[i] + turn(i - first)));
        }
        return false;
    }

    const ob::SpaceInformationPtr information_;
    const Scene &scene_;
    std::vector<long> ends_;
};

ob::PlannerPtr named(const std::string &name, const ob::SpaceInformationPtr &information, const Scene &scene) {
    if (name == "RRTConnect") return std::make_shared<og::RRTConnect>(information);
    if (name == "KPIECE1") return std::make_shared<og::KPIECE1>(information);
    if (name == "BITstar") return std::make_shared<og::BITstar>(information);
    if (name == "STRIDE") return std::make_shared<og::STRIDE>(information);
    if (name != "XXL") return nullptr;
    double reach = 1.05 * double(scene.links) * scene.length;
    ob::RealVectorBounds box(2);
    for (unsigned int k = 0; k < 2; ++k) {
        box.setLow(k, scene.base[k] - reach);
        box.setHigh(k, scene.base[k] + reach);
    }
    auto layers = std::make_shared<Layers>(information, scene, box, std::max(2, int(scene.links) / 3));
    return std::make_shared<og::XXL>(information, layers);
}

}  // namespace

/* Number of poses of the way found, written to way (most, links); 0 when the time is up, -1 for an unknown planner. */
extern "C" long ompl_plan(const char *name, const Scene *scene, const double *start, const double *goals, long goal_count,
                          double x, double y, double position, double heading, double heading_tolerance, double seconds,
                          std::uint32_t seed, double *way, long most, double *used) {
    ompl::msg::noOutputHandler();
    ompl::RNG::setSeed(seed);
    auto space = std::make_shared<ob::RealVectorStateSpace>(unsigned(scene->links));
    ob::RealVectorBounds bounds(unsigned(scene->links));
    for (unsigned int k = 0; k < unsigned(scene->links); ++k) {
        bounds.setLow(k, -scene->limits[k]);
        bounds.setHigh(k, scene->limits[k]);
    }
    space->setBounds(bounds);
    space->registerDefaultProjection(std::make_shared<TipProjection>(space, *scene));
    og::SimpleSetup setup(space);
    ob::SpaceInformationPtr information = setup.getSpaceInformation();
    setup.setStateValidityChecker([scene](const ob::State *state) { return pose_free(*scene, state); });
    information->setMotionValidator(std::make_shared<SweptMotions>(information, *scene));
    ob::ScopedState<> first(space);
    std::memcpy(bends(first.get()), start, sizeof(double) * std::size_t(scene->links));
    setup.setStartState(first);
    GoalSet set{x, y, position, heading, heading_tolerance};
    setup.setGoal(std::make_shared<GoalRegion>(information, *scene, set, goals, goal_count));
    ob::PlannerPtr planner = named(name, information, *scene);
    if (planner == nullptr) return -1;
    setup.setPlanner(planner);
    const std::clock_t begun = std::clock();
    const ob::ProblemDefinitionPtr definition = setup.getProblemDefinition();
    setup.setup();
    setup.solve(ob::PlannerTerminationCondition([begun, seconds, definition]() {
        return double(std::clock() - begun) > seconds * CLOCKS_PER_SEC || definition->hasExactSolution();
    }));
    *used = double(std::clock() - begun) / CLOCKS_PER_SEC;
    if (!setup.haveExactSolutionPath()) return 0;
    const std::vector<ob::State *> &states = setup.getSolutionPath().getStates();
    for (std::size_t k = 0; k < states.size() && k < std::size_t(most); ++k)
        std::memcpy(way + k * std::size_t(scene->links), bends(states[k]), sizeof(double) * std::size_t(scene->links));
    return long(states.size());
}
