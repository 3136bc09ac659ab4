#pragma once

#include "StubTypes.h"

#include <algorithm>
#include <cmath>

template <typename Real>
struct TVector {
  Real X = 0, Y = 0, Z = 0;
  TVector() = default;
  TVector(Real InX, Real InY, Real InZ) : X(InX), Y(InY), Z(InZ) {}
  template <typename Other, std::enable_if_t<!std::is_same_v<Other, Real>, int> = 0>
  explicit TVector(const TVector<Other>& From) : X(Real(From.X)), Y(Real(From.Y)), Z(Real(From.Z)) {}
  TVector operator+(const TVector& Other) const { return TVector(X + Other.X, Y + Other.Y, Z + Other.Z); }
  TVector operator-(const TVector& Other) const { return TVector(X - Other.X, Y - Other.Y, Z - Other.Z); }
  TVector operator*(Real Scale) const { return TVector(X * Scale, Y * Scale, Z * Scale); }
  TVector& operator+=(const TVector& Other) { return *this = *this + Other; }
  bool operator==(const TVector& Other) const { return X == Other.X && Y == Other.Y && Z == Other.Z; }
  bool Equals(const TVector& Other, Real Tolerance = Real(1.0e-4)) const {
    return std::abs(X - Other.X) <= Tolerance && std::abs(Y - Other.Y) <= Tolerance && std::abs(Z - Other.Z) <= Tolerance;
  }
  Real Size() const { return std::sqrt(X * X + Y * Y + Z * Z); }
  bool ContainsNaN() const { return !std::isfinite(X) || !std::isfinite(Y) || !std::isfinite(Z); }
  TVector GetSafeNormal() const {
    const Real Length = Size();
    return Length > Real(1.0e-8) ? *this * (Real(1) / Length) : TVector();
  }
  static TVector CrossProduct(const TVector& A, const TVector& B) {
    return TVector(A.Y * B.Z - A.Z * B.Y, A.Z * B.X - A.X * B.Z, A.X * B.Y - A.Y * B.X);
  }
  static Real DotProduct(const TVector& A, const TVector& B) { return A.X * B.X + A.Y * B.Y + A.Z * B.Z; }
  static const TVector ZeroVector;
};
template <typename Real>
inline const TVector<Real> TVector<Real>::ZeroVector{};
using FVector = TVector<double>;
using FVector3d = TVector<double>;
using FVector3f = TVector<float>;

template <typename Real>
struct TVector2 {
  Real X = 0, Y = 0;
  TVector2() = default;
  TVector2(Real InX, Real InY) : X(InX), Y(InY) {}
  template <typename Other, std::enable_if_t<!std::is_same_v<Other, Real>, int> = 0>
  explicit TVector2(const TVector2<Other>& From) : X(Real(From.X)), Y(Real(From.Y)) {}
};
using FVector2D = TVector2<double>;
using FVector2f = TVector2<float>;

struct FVector4f {
  float X, Y, Z, W;
  FVector4f(float InX, float InY, float InZ, float InW) : X(InX), Y(InY), Z(InZ), W(InW) {}
};

struct FColor {
  uint8 B = 0, G = 0, R = 0, A = 0;
  FColor() = default;
  FColor(uint8 InR, uint8 InG, uint8 InB, uint8 InA = 255) : B(InB), G(InG), R(InR), A(InA) {}
};

struct FLinearColor {
  float R = 0, G = 0, B = 0, A = 1;
  static const FLinearColor Black;
};
inline const FLinearColor FLinearColor::Black{};

template <typename Vector>
struct TBox {
  Vector Min, Max;
  uint8 IsValid = 0;
  TBox() = default;
  explicit TBox(EForceInit) {}
  TBox(const Vector& InMin, const Vector& InMax) : Min(InMin), Max(InMax), IsValid(1) {}
  TBox& operator+=(const Vector& Point) {
    if (IsValid == 0) {
      Min = Max = Point;
      IsValid = 1;
      return *this;
    }
    Min = Vector(std::min(Min.X, Point.X), std::min(Min.Y, Point.Y), std::min(Min.Z, Point.Z));
    Max = Vector(std::max(Max.X, Point.X), std::max(Max.Y, Point.Y), std::max(Max.Z, Point.Z));
    return *this;
  }
  TBox& operator+=(const TBox& Other) {
    if (Other.IsValid != 0) {
      *this += Other.Min;
      *this += Other.Max;
    }
    return *this;
  }
  Vector GetCenter() const { return (Min + Max) * 0.5; }
  Vector GetExtent() const { return (Max - Min) * 0.5; }
  TBox TransformBy(const struct FMatrix&) const { return *this; }
};
struct FMatrix {};
using FBox = TBox<FVector>;
using FBox3f = TBox<FVector3f>;

struct FTransform;
struct FBoxSphereBounds {
  FVector Origin, BoxExtent;
  explicit FBoxSphereBounds(const FBox& Box) : Origin(Box.GetCenter()), BoxExtent(Box.GetExtent()) {}
  FBoxSphereBounds TransformBy(const FTransform&) const { return *this; }
};

struct FRotator {
  double Pitch = 0, Yaw = 0, Roll = 0;
  FRotator() = default;
  FRotator(double InPitch, double InYaw, double InRoll) : Pitch(InPitch), Yaw(InYaw), Roll(InRoll) {}
};

/// A location and a yaw: what the tests turn and move actors by.
struct FTransform {
  FVector StubLocation;
  double YawDegrees = 0;
  FVector Turned(const FVector& V, double Degrees) const {
    const double Angle = Degrees * 3.14159265358979323846 / 180.0;
    return FVector(V.X * std::cos(Angle) - V.Y * std::sin(Angle), V.X * std::sin(Angle) + V.Y * std::cos(Angle), V.Z);
  }
  FRotator Rotator() const { return FRotator(0.0, YawDegrees, 0.0); }
  FVector TransformPosition(const FVector& V) const { return Turned(V, YawDegrees) + StubLocation; }
  FVector InverseTransformPosition(const FVector& V) const { return Turned(V - StubLocation, -YawDegrees); }
  FVector TransformVectorNoScale(const FVector& V) const { return Turned(V, YawDegrees); }
  FVector InverseTransformVectorNoScale(const FVector& V) const { return Turned(V, -YawDegrees); }
};
