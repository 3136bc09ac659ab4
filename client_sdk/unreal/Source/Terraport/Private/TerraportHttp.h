#pragma once

#include "CoreMinimal.h"

#include "Core/Http.h"

#include <cstdint>
#include <map>
#include <string>

/**
 * The core's HTTP on the engine's module. Game thread: the module calls back there.
 *
 * The engine follows redirects by itself and cannot be told not to: give addresses that need none.
 */
class FTerraportHttp final : public terraport::Http
{
public:
	FTerraportHttp() = default;
	/** Cancels what is under way. */
	virtual ~FTerraportHttp() override;
	FTerraportHttp(const FTerraportHttp&) = delete;
	FTerraportHttp& operator=(const FTerraportHttp&) = delete;

	virtual std::uint64_t get(const std::string& Url, const std::string& BearerToken, std::size_t MaxBytes) override;
	virtual bool poll(std::uint64_t Request, terraport::HttpAnswer& Answer) override;
	virtual void cancel(std::uint64_t Request) override;

private:
	struct FExchange;
	std::map<std::uint64_t, TSharedPtr<FExchange>> Requests;
	std::uint64_t Last = 0;
};
