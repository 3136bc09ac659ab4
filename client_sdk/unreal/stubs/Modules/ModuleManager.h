#pragma once

#include "CoreMinimal.h"

class IModuleInterface
{
public:
	virtual ~IModuleInterface() = default;
};

class FDefaultModuleImpl : public IModuleInterface
{
};

/// Modules of the stubs are set by tests.
class FModuleManager
{
public:
	static FModuleManager& Get()
	{
		static FModuleManager Manager;
		return Manager;
	}
	IModuleInterface* LoadModule(const FName&)
	{
		return nullptr;
	}
	template <typename T>
	static T* GetModulePtr(const FName&)
	{
		return T::Stub;
	}
	template <typename T>
	static T& LoadModuleChecked(const FName&)
	{
		return *T::Stub;
	}
};

#define IMPLEMENT_MODULE(Class, Name) static_assert(sizeof(Class) > 0, #Name);
