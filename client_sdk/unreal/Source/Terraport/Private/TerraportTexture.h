#pragma once

#include "CoreMinimal.h"

#include "Core/Segment.h"
#include "PixelFormat.h"

#include <vector>

class UTexture2D;

/** An image with all its mips, sRGB: rows of BGRA bytes, or of blocks that the graphics keep as they are. */
struct FTerraportPixels
{
	EPixelFormat Format = PF_B8G8R8A8;
	int32 Width = 0;
	int32 Height = 0;
	/** The whole image first. Empty where there is none. */
	std::vector<TArray64<uint8>> Mips;

	bool IsEmpty() const { return Mips.empty(); }
};

namespace TerraportTexture
{
/**
 * Decode a payload's image and make its mips. For worker threads; the module ImageWrapper must have been loaded before (the
 * scene does that when it opens). A KTX2 becomes what this device's graphics keep compressed: BC1, or ETC1 as a part of ETC2.
 * Empty where there is no image, where its format is none that is read (WebP), where the graphics have neither of the two, or
 * where it is damaged: the ground is then drawn in its regions' mean colour.
 */
FTerraportPixels Decode(const terraport::SegmentImage& Image, terraport::ByteSpan Payload);

/** Linear light of a level of sRGB, in 16 bits. */
uint16 LinearOf(uint8 Level);

/** Mips of an image whose sides are powers of two, each pixel the mean of four in linear light. */
void MakeMips(FTerraportPixels& Pixels);

/** A texture of these pixels; game thread. Null where there are none, or no memory. The pixels are emptied. */
UTexture2D* MakeTexture(FTerraportPixels& Pixels);
} // namespace TerraportTexture
