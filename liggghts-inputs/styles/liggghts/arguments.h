// Reads the arguments of a fix, and refuses them with a message that names keyword, value and what is allowed.
#pragma once

#include <charconv>
#include <cmath>
#include <cstdio>
#include <string>

#include "error.h"
#include "lammps.h"

namespace poreslip {

inline std::string text_of(double value)
{
  char text[32];
  snprintf(text, sizeof text, "%g", value);
  return text;
}

class Arguments {
 public:
  // command: what the messages begin with, such as "fix top wall/plane".
  Arguments(LAMMPS_NS::LAMMPS *lmp, std::string command, int count, char **values, int first) :
      lmp_(lmp), command_(std::move(command)), count_(count), values_(values), next_(first)
  {}

  bool done() const { return next_ >= count_; }
  int position() const { return next_; }

  std::string word(const std::string &keyword, const std::string &allowed)
  {
    if (done()) refuse(keyword, "missing", allowed);
    return values_[next_++];
  }

  template <class Predicate>
  double number(const std::string &keyword, Predicate in_range, const std::string &allowed)
  {
    const std::string text = word(keyword, allowed);
    double value = 0.0;
    if (!parse(text, value) || !in_range(value)) refuse(keyword, text, allowed);
    return value;
  }

  bool yes_or_no(const std::string &keyword)
  {
    const std::string text = word(keyword, "yes, no");
    if (text != "yes" && text != "no") refuse(keyword, text, "yes, no");
    return text == "yes";
  }

  // True if the next argument is a number; it is not consumed.
  bool number_follows() const
  {
    double ignored = 0.0;
    return !done() && parse(values_[next_], ignored);
  }

  [[noreturn]] void refuse(const std::string &keyword, const std::string &value, const std::string &allowed) const
  {
    fail(keyword + " is " + value + ", allowed: " + allowed);
  }

  [[noreturn]] void fail(const std::string &what) const
  {
    lmp_->error->all(FLERR, (command_ + ": " + what).c_str());
    std::abort();  // not reached: LIGGGHTS ends the process, or the engine guard throws
  }

  // Decimal number, or "infinite".
  static bool parse(const std::string &text, double &value)
  {
    if (text == "infinite") {
      value = HUGE_VAL;
      return true;
    }
    const char *begin = text.c_str() + (text.size() > 1 && text[0] == '+' ? 1 : 0);
    const char *end = text.c_str() + text.size();
    const auto [stop, status] = std::from_chars(begin, end, value);
    return status == std::errc() && stop == end && std::isfinite(value);
  }

 private:
  LAMMPS_NS::LAMMPS *lmp_;
  std::string command_;
  int count_;
  char **values_;
  int next_;
};

}  // namespace poreslip
