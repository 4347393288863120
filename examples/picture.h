#pragma once

#include <array>
#include <fstream>
#include <string>
#include <vector>

/// A drawing for the examples, written to an SVG file; y points up, and lengths are those of the
/// problem.
class Picture {
 public:
  /// The part of the plane that is shown: its lower left corner and its size.
  Picture(const std::string& path, double x, double y, double width, double height)
      : svg_(path), line_width_(0.003 * width) {
    svg_ << "<svg xmlns='http://www.w3.org/2000/svg' viewBox='" << x << ' ' << -y - height << ' '
         << width << ' ' << height << "' font-family='sans-serif' font-size='" << 0.028 * width
         << "'>\n<rect x='" << x << "' y='" << -y - height << "' width='" << width << "' height='"
         << height << "' fill='white'/>\n";
  }

  void Dot(double x, double y, const char* color) {
    svg_ << "<circle cx='" << x << "' cy='" << -y << "' r='" << 1.6 * line_width_ << "' fill='"
         << color << "'/>\n";
  }
  void Circle(double x, double y, double radius, const char* color) {
    svg_ << "<circle cx='" << x << "' cy='" << -y << "' r='" << radius
         << "' fill='none' stroke-width='" << line_width_ << "' stroke='" << color << "'/>\n";
  }
  void Line(const std::vector<std::array<double, 2>>& points, const char* color) {
    svg_ << "<polyline fill='none' stroke-width='" << line_width_ << "' stroke='" << color
         << "' points='";
    for (const auto& point : points) {
      svg_ << point[0] << ',' << -point[1] << ' ';
    }
    svg_ << "'/>\n";
  }
  void Text(double x, double y, const std::string& text, const char* color) {
    svg_ << "<text x='" << x << "' y='" << -y << "' fill='" << color << "'>" << text << "</text>\n";
  }

  /// Ends the drawing; false if it could not be written.
  bool Close() {
    svg_ << "</svg>\n";
    svg_.close();
    return !svg_.fail();
  }

 private:
  std::ofstream svg_;
  double line_width_;
};
