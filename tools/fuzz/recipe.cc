#include <algorithm>

#include "tools/fuzz/world.h"

namespace inceres::fuzz {
namespace {

void Bundle(Dice* dice, Recipe* recipe) {
  constexpr int kCameraSizes[] = {3, 6, 6, 7};
  recipe->projective = true;
  recipe->frame_sizes = {kCameraSizes[dice->Int(0, 3)]};
  recipe->point_sizes = {3};
  recipe->num_frames = dice->Int(2, 9);
  recipe->num_points = dice->Int(4, 30);
  recipe->views = dice->Int(2, 4);
  recipe->link_chance = dice->Chance(0.3) ? 0.5 : 0.0;
  recipe->noise = dice->Magnitude(1e-4, 0.05);
}

void Chain(Dice* dice, Recipe* recipe) {
  recipe->frame_sizes = {dice->Int(1, 8)};
  recipe->num_frames = dice->Int(3, 16);
  recipe->link_chance = 1.0;
  recipe->loop_chance = dice->Chance(0.5) ? 0.2 : 0.0;
}

void PoseGraph(Dice* dice, Recipe* recipe) {
  recipe->frame_sizes = {dice->Chance(0.5) ? 7 : 4};
  recipe->num_frames = dice->Int(3, 16);
  recipe->link_chance = 1.0;
  recipe->loop_chance = 0.3;
  recipe->manifold_chance = 0.9;
}

void Star(Dice* dice, Recipe* recipe) {
  recipe->frame_sizes = {dice->Int(1, 10)};
  recipe->point_sizes = {1, 2, 3, 4};
  recipe->num_frames = dice->Int(1, 2);
  recipe->num_points = dice->Int(5, 30);
  recipe->views = 1;
}

void DenseSmall(Dice* dice, Recipe* recipe) {
  recipe->frame_sizes = {dice->Int(1, 30), dice->Int(1, 30), dice->Int(1, 5)};
  recipe->num_frames = dice->Int(1, 5);
  recipe->link_chance = 1.0;
  recipe->loop_chance = 0.5;
}

void Mixed(Dice* dice, Recipe* recipe) {
  recipe->frame_sizes = {dice->Int(1, 12), dice->Int(1, 7), 7, 6, 4};
  recipe->point_sizes = {1, 2, 3, 4};
  recipe->num_frames = dice->Int(2, 8);
  recipe->num_points = dice->Int(1, 20);
  recipe->views = dice->Int(1, 3);
  recipe->link_chance = 0.7;
  recipe->loop_chance = 0.2;
}

}  // namespace

Recipe RandomRecipe(bool bounds, Dice* dice) {
  Recipe recipe;
  recipe.noise = dice->Magnitude(1e-3, 1.0);
  recipe.manifold_chance = dice->Chance(0.5) ? 0.3 : 0.0;
  constexpr void (*kShapes[])(Dice*, Recipe*) = {Bundle, Bundle,     Chain, PoseGraph,
                                                 Star,   DenseSmall, Mixed, Mixed};
  kShapes[dice->Int(0, 7)](dice, &recipe);
  if (dice->Chance(0.1)) {
    recipe.noise = 0.0;  // the cost at the minimum is that of rounding
  }
  recipe.prior_chance = dice->Chance(0.7) ? 1.0 : dice->Unit();
  recipe.distance_chance = dice->Chance(0.3) ? 0.3 : 0.0;
  recipe.loss_chance = dice->Chance(0.6) ? dice->Unit() : 0.0;
  recipe.constant_chance = dice->Chance(0.5) ? 0.15 : 0.0;
  recipe.bound_chance = bounds && dice->Chance(0.2) ? 0.3 : 0.0;
  recipe.curvature = dice->Chance(0.3) ? 0.0 : dice->Between(0.0, 0.7);
  recipe.perturbation = dice->Magnitude(0.01, recipe.projective ? 0.3 : 1.0);
  recipe.weight_spread = dice->Chance(0.5) ? 1.0 : dice->Magnitude(1.0, 1e3);
  recipe.fast_removal = dice->Chance(0.5);
  return recipe;
}

Recipe DegenerateRecipe(Dice* dice) {
  Recipe recipe = RandomRecipe(/*bounds=*/false, dice);
  Bundle(dice, &recipe);
  recipe.unguarded = true;
  recipe.rays = dice->Chance(0.5);
  recipe.frame_sizes = {3};
  recipe.point_sizes = {recipe.rays ? 1 : 3};
  recipe.manifold_chance = 0.0;
  recipe.perturbation = dice->Magnitude(0.01, 0.3);
  return recipe;
}

}  // namespace inceres::fuzz
